/* SPDX-License-Identifier: MIT */
/*
 * The table, and beside it a process that is told each frame's nodes in one message before they are
 * read, and answers in shared memory: as oocd is told, but nothing is done with what it hears.  What a
 * cache is that knows who holds what cannot be faster than this.
 */
#include <errno.h>
#include <sched.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "formats/base/bytes.h"
#include "formats/base/file.h"
#include "libclient/wire.h"
#include "tools/bench/contest/contest.h"

/** Looks at the answer before somebody else may have the processor. */
#define LOOK_COUNT 2000u

struct asked {
	void *table;
	int fd;
	pid_t pid;
	_Atomic uint64_t *answered; /* serial; in memory that both have */
	uint64_t serial;            /* of the newest message */
	const struct contest_frame *said;
	struct wire_set *message;
};

static void asked_close(void *arg)
{
	struct asked *self = arg;

	self->fd = fd_close(self->fd);
	while (self->pid > 0 && waitpid(self->pid, NULL, 0) < 0 && errno == EINTR)
		;
	if (self->answered)
		(void)munmap(self->answered, sizeof(*self->answered));
	if (self->table)
		contestant_table.close(self->table);
	free(self->message);
	free(self);
}

static _Noreturn void answer(int fd, struct wire_set *message, _Atomic uint64_t *answered)
{
	(void)prctl(PR_SET_PDEATHSIG, SIGKILL);
	while (recv(fd, message, WIRE_MESSAGE_BYTES_MAX, 0) > 0)
		atomic_store_explicit(answered, message->serial, memory_order_release);
	_exit(0);
}

static int start(struct asked *self, struct why *why)
{
	int fds[2];

	self->message = calloc(1, WIRE_MESSAGE_BYTES_MAX);
	self->answered = mmap(NULL, sizeof(*self->answered), PROT_READ | PROT_WRITE,
			      MAP_SHARED | MAP_ANONYMOUS, -1, 0);
	if (self->answered == MAP_FAILED)
		self->answered = NULL;
	if (!self->message || !self->answered)
		return why_set(why, -ENOMEM, "out of memory");
	if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, fds) < 0)
		return why_errno(why, -errno, "a socket");
	self->pid = fork();
	if (self->pid == 0) {
		(void)fd_close(fds[0]);
		answer(fds[1], self->message, self->answered);
	}
	(void)fd_close(fds[1]);
	self->fd = fds[0];
	return self->pid < 0 ? why_errno(why, -errno, "a process") : 0;
}

static int asked_open(const struct contest_config *config, void **ret_self, struct why *why)
{
	struct asked *self = calloc(1, sizeof(*self));
	int r;

	if (!self)
		return why_set(why, -ENOMEM, "out of memory");
	self->fd = -1;
	r = contestant_table.open(config, &self->table, why);
	if (r == 0)
		r = start(self, why);
	if (r < 0)
		asked_close(self);
	else
		*ret_self = self;
	return r;
}

/* As many nodes as one message has room for: a frame that has more is told too cheaply. */
static int say(struct asked *self, const struct contest_frame *frame, struct why *why)
{
	struct wire_set *message = self->message;
	int r;

	message->serial = ++self->serial;
	message->entry_count = (uint32_t)u64_min(frame->node_count, WIRE_SET_ENTRY_COUNT_MAX);
	for (uint32_t i = 0; i < message->entry_count; i++)
		message->entries[i] = (struct wire_entry){ .node = frame->nodes[i] };
	wire_header_init(&message->header, WIRE_SET,
			 sizeof(*message) + message->entry_count * sizeof(message->entries[0]));
	self->said = frame;
	r = wire_send(self->fd, message, message->header.bytes, NULL, 0);
	return r < 0 ? why_errno(why, r, "telling what is read") : 0;
}

static int asked_frame(void *arg, const struct contest_frame *frame,
		       const struct contest_frame *next, struct contest_touch *touch,
		       struct why *why)
{
	struct asked *self = arg;
	int r = self->said == frame ? 0 : say(self, frame, why);

	/* Pairs with the answering process's release store. */
	for (unsigned i = 0;
	     r == 0 && atomic_load_explicit(self->answered, memory_order_acquire) < self->serial;
	     i++)
		if (i % LOOK_COUNT == LOOK_COUNT - 1)
			(void)sched_yield();
	if (r == 0 && next)
		r = say(self, next, why);
	return r < 0 ? r : contestant_table.frame(self->table, frame, next, touch, why);
}

const struct contestant contestant_asked = { "asked", asked_open, asked_frame, NULL, asked_close };
