/* SPDX-License-Identifier: MIT */
#include "tools/bench/contest/contest.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "formats/base/bytes.h"
#include "formats/base/clock.h"
#include "formats/base/file.h"
#include "tools/bench/base/measure.h"
#include "tools/bench/contest/memory_box.h"

#define LINE_BYTES 64u

/* What the two processes write into for each other; one at a time does. */
struct shared {
	bool cold;
	bool every_byte;
	int error;
	struct why why;
	struct contest_round round;
};

struct contest_seat {
	pid_t pid;
	int socket_fd;
	struct shared *shared;
	struct memory_box box;
};

static uint64_t sum_words(const void *data, size_t bytes)
{
	const uint8_t *at = data;
	uint64_t sum = 0;

	for (size_t i = 0; i + sizeof(uint64_t) <= bytes; i += sizeof(uint64_t)) {
		uint64_t word;

		memcpy(&word, at + i, sizeof(word));
		sum += word;
	}
	return sum;
}

void contest_touch(struct contest_touch *touch, const void *payload, size_t bytes)
{
	size_t line_bytes = u64_min(bytes, LINE_BYTES);

	if (touch->every_byte) {
		touch->sum += sum_words(payload, bytes);
		return;
	}
	touch->sum += sum_words(payload, line_bytes) +
		      sum_words((const uint8_t *)payload + bytes - line_bytes, line_bytes);
}

void contest_drop_file(int fd)
{
	/* Written pages first: they cannot be dropped. */
	(void)fdatasync(fd);
	(void)posix_fadvise(fd, 0, 0, POSIX_FADV_DONTNEED);
}

/* ---- in the contestant's process ---- */

static int run_walk(const struct contestant *contestant, void *self,
		    const struct contest_walk *walk, struct shared *shared)
{
	struct contest_touch touch = { .every_byte = shared->every_byte };
	uint64_t begin_ns = clock_now_ns();
	uint64_t before_ns = begin_ns;

	for (size_t i = 0; i < walk->frame_count; i++) {
		const struct contest_frame *next =
			i + 1 < walk->frame_count ? &walk->frames[i + 1] : NULL;
		uint64_t now_ns;
		int r = contestant->frame(self, &walk->frames[i], next, &touch, &shared->why);

		if (r < 0)
			return r;
		now_ns = clock_now_ns();
		shared->round.frame_us[i] = (float)(now_ns - before_ns) / 1e3f;
		before_ns = now_ns;
	}
	shared->round.seconds = (double)(before_ns - begin_ns) / (double)NS_PER_S;
	shared->round.sum = touch.sum;
	return 0;
}

/*
 * Opens, if nothing has gone wrong yet; tells that it is ready, then runs when it is told to, until the
 * other side hangs up.
 */
static void contestant_live(const struct contestant *contestant,
			    const struct contest_config *config, int fd, struct shared *shared)
{
	void *self = NULL;
	char byte = 0;

	if (shared->error == 0)
		shared->error = contestant->open(config, &self, &shared->why);
	if (shared->error < 0) {
		(void)!write(fd, &byte, 1);
		return;
	}
	while (write(fd, &byte, 1) == 1 && read(fd, &byte, 1) == 1) {
		shared->error = shared->cold ? contestant->forget(self, &shared->why) : 0;
		if (shared->error == 0)
			shared->error = run_walk(contestant, self, config->walk, shared);
		/* What it maps it keeps in the page cache, for others to find. */
		if (shared->error == 0 && shared->cold)
			shared->error = contestant->forget(self, &shared->why);
	}
	contestant->close(self);
}

/* ---- outside of it ---- */

/* Waits for the contestant's turn to end. */
static int wait_for_it(struct contest_seat *seat, struct why *why)
{
	char byte;
	ssize_t n;

	do
		n = read(seat->socket_fd, &byte, 1);
	while (n < 0 && errno == EINTR && !measure_was_cancelled());
	if (measure_was_cancelled())
		return why_set(why, -ECANCELED, "interrupted");
	if (n != 1)
		return why_set(why, -ECHILD, "its process has ended");
	if (seat->shared->error < 0)
		*why = seat->shared->why;
	return seat->shared->error;
}

int contest_enter(const struct contestant *contestant, const struct contest_config *config,
		  struct contest_seat **ret, struct why *why)
{
	struct contest_seat *seat = calloc(1, sizeof(*seat));
	int fds[2] = { -1, -1 };
	int r = 0;

	if (!seat)
		return why_set(why, -ENOMEM, "out of memory");
	seat->socket_fd = -1;
	seat->shared = mmap(NULL, sizeof(*seat->shared), PROT_READ | PROT_WRITE,
			    MAP_SHARED | MAP_ANONYMOUS, -1, 0);
	if (seat->shared == MAP_FAILED) {
		seat->shared = NULL;
		r = why_errno(why, -errno, "shared memory");
	} else if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, fds) < 0) {
		r = why_errno(why, -errno, "a socket");
	} else if (config->limit_bytes > 0) {
		r = memory_box_make(config->limit_bytes, &seat->box, why);
	}
	seat->socket_fd = fds[0];
	if (r == 0)
		seat->pid = fork();
	if (r == 0 && seat->pid == 0) {
		(void)prctl(PR_SET_PDEATHSIG, SIGTERM);
		(void)fd_close(fds[0]);
		if (config->limit_bytes > 0)
			seat->shared->error = memory_box_enter(&seat->box, &seat->shared->why);
		contestant_live(contestant, config, fds[1], seat->shared);
		_exit(0);
	}
	if (r == 0 && seat->pid < 0)
		r = why_errno(why, -errno, "a process");
	(void)fd_close(fds[1]);
	if (r == 0)
		r = wait_for_it(seat, why);
	if (r < 0)
		seat = contest_leave(seat);
	*ret = seat;
	return r;
}

int contest_run(struct contest_seat *seat, bool cold, bool every_byte,
		const struct contest_round **ret, struct why *why)
{
	char byte = 0;
	int r;

	seat->shared->cold = cold;
	seat->shared->every_byte = every_byte;
	if (write(seat->socket_fd, &byte, 1) != 1)
		return why_errno(why, -errno, "its process");
	r = wait_for_it(seat, why);
	*ret = &seat->shared->round;
	return r;
}

struct contest_seat *contest_leave(struct contest_seat *seat)
{
	if (!seat)
		return NULL;
	/* Contestants that were started later have inherited the descriptor. */
	(void)shutdown(seat->socket_fd, SHUT_RDWR);
	(void)fd_close(seat->socket_fd);
	while (seat->pid > 0 && waitpid(seat->pid, NULL, 0) < 0 && errno == EINTR)
		;
	memory_box_done(&seat->box);
	if (seat->shared)
		(void)munmap(seat->shared, sizeof(*seat->shared));
	free(seat);
	return NULL;
}
