/* SPDX-License-Identifier: MIT */
/*
 * memcached on a Unix socket, as its documentation advises: one connection that is kept, many keys in
 * one request (meta gets that are answered with their key, ended by mn, so that misses are not
 * answered), items of any size, the store read where it misses and the payload set.
 */
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/uio.h>
#include <sys/un.h>
#include <unistd.h>

#include "formats/base/bytes.h"
#include "formats/base/clock.h"
#include "formats/base/file.h"
#include "tools/bench/base/measure.h"
#include "tools/bench/contest/contest.h"

/** Keys of one request: so many that a round trip costs little, and their answers fit into the buffer. */
#define KEYS_AT_ONCE 64u
#define BUFFER_BYTES (STORE_PAYLOAD_BYTES_MAX + MIB)
#define READ_BYTES   MIB
#define START_NS     (10 * NS_PER_S)
/** Of memory where nothing is said: what memcached needs for items that are cut to its slabs. */
#define SPARE_FACTOR 2u

struct memcached {
	const struct contest_config *config;
	struct measure_child child;
	char socket_path[sizeof(((struct sockaddr_un *)NULL)->sun_path)];
	int fd;
	int store_fd;
	uint8_t *payload;
	uint8_t *is_found; /* of nodes; this frame */
	uint8_t *buffer;   /* [begin, end) is unread */
	size_t begin;
	size_t end;
};

static int lost(struct why *why)
{
	return why_set(why, -EIO, "memcached: does not answer");
}

static int say(const struct memcached *self, const void *data, size_t bytes, struct why *why)
{
	const uint8_t *at = data;

	while (bytes > 0) {
		ssize_t n = send(self->fd, at, bytes, MSG_NOSIGNAL);

		if (n < 0 && errno != EINTR)
			return lost(why);
		at += n > 0 ? n : 0;
		bytes -= n > 0 ? (size_t)n : 0;
	}
	return 0;
}

/* Has at least `bytes` unread, of which there are fewer than the buffer holds. */
static int hear(struct memcached *self, size_t bytes, struct why *why)
{
	/* At the front again wherever possible: the buffer's rest costs memory only once it is used. */
	if (self->begin == self->end) {
		self->begin = 0;
		self->end = 0;
	}
	if (self->begin + bytes > BUFFER_BYTES) {
		memmove(self->buffer, self->buffer + self->begin, self->end - self->begin);
		self->end -= self->begin;
		self->begin = 0;
	}
	while (self->end - self->begin < bytes) {
		ssize_t n = read(self->fd, self->buffer + self->end,
				 u64_min(BUFFER_BYTES - self->end, READ_BYTES));

		if (n == 0 || (n < 0 && errno != EINTR))
			return lost(why);
		self->end += n > 0 ? (size_t)n : 0;
	}
	return 0;
}

/* The next line, without its end. */
static int hear_line(struct memcached *self, char *ret, size_t ret_bytes, struct why *why)
{
	for (size_t length = 0; length < ret_bytes; length++) {
		int r = hear(self, length + 2, why);

		if (r < 0)
			return r;
		if (memcmp(self->buffer + self->begin + length, "\r\n", 2) == 0) {
			memcpy(ret, self->buffer + self->begin, length);
			ret[length] = '\0';
			self->begin += length + 2;
			return 0;
		}
	}
	return lost(why);
}

static int put(struct memcached *self, uint32_t number, struct why *why)
{
	const struct store_node *node = &self->config->walk->nodes[number];
	char text[64];
	int length = snprintf(text, sizeof(text), "ms %u %u\r\n", number, node->payload_bytes);
	int r;

	if (pread(self->store_fd, self->payload, node->payload_bytes, (off_t)node->file_offset) !=
	    (ssize_t)node->payload_bytes)
		return why_set(why, -EIO, "%s: cannot be read", self->config->walk->store);
	memcpy(self->payload + node->payload_bytes, "\r\n", 2);
	r = say(self, text, (size_t)length, why);
	if (r == 0)
		r = say(self, self->payload, node->payload_bytes + 2, why);
	if (r == 0)
		r = hear_line(self, text, sizeof(text), why);
	/* An item that finds no room is not kept: the next one to ask reads it again. */
	return r;
}

static int ask(struct memcached *self, const uint32_t *numbers, size_t count, struct why *why)
{
	char text[KEYS_AT_ONCE * 24 + 8];
	size_t length = 0;

	for (size_t i = 0; i < count; i++)
		length += (size_t)snprintf(text + length, sizeof(text) - length, "mg %u v k q\r\n",
					   numbers[i]);
	length += (size_t)snprintf(text + length, sizeof(text) - length, "mn\r\n");
	return say(self, text, length, why);
}

/* Takes answers until the last one. */
static int take(struct memcached *self, struct contest_touch *touch, struct why *why)
{
	for (;;) {
		unsigned bytes;
		unsigned number;
		char line[128];
		int r = hear_line(self, line, sizeof(line), why);

		if (r < 0)
			return r;
		if (strcmp(line, "MN") == 0)
			return 0;
		if (sscanf(line, "VA %u k%u", &bytes, &number) != 2 ||
		    number >= self->config->walk->superblock.node_count ||
		    bytes != self->config->walk->nodes[number].payload_bytes)
			return why_set(why, -EPROTO, "memcached: answers \"%s\"", line);
		r = hear(self, bytes + 2, why);
		if (r < 0)
			return r;
		contest_touch(touch, self->buffer + self->begin, bytes);
		self->begin += bytes + 2;
		self->is_found[number] = 1;
	}
}

static int memcached_frame(void *arg, const struct contest_frame *frame,
			   const struct contest_frame *next, struct contest_touch *touch,
			   struct why *why)
{
	struct memcached *self = arg;
	int r = 0;

	(void)next;
	for (size_t from = 0; r == 0 && from < frame->node_count; from += KEYS_AT_ONCE) {
		size_t count = u64_min(KEYS_AT_ONCE, frame->node_count - from);

		r = ask(self, frame->nodes + from, count, why);
		if (r == 0)
			r = take(self, touch, why);
	}
	for (size_t i = 0; r == 0 && i < frame->node_count; i++) {
		uint32_t number = frame->nodes[i];

		if (!self->is_found[number]) {
			r = put(self, number, why);
			contest_touch(touch, self->payload,
				      self->config->walk->nodes[number].payload_bytes);
		}
		self->is_found[number] = 0;
	}
	return r;
}

static int memcached_forget(void *arg, struct why *why)
{
	struct memcached *self = arg;
	char line[64];
	int r = say(self, "flush_all\r\n", 11, why);

	contest_drop_file(self->store_fd);
	return r < 0 ? r : hear_line(self, line, sizeof(line), why);
}

static void memcached_close(void *arg)
{
	struct memcached *self = arg;

	(void)fd_close(self->fd);
	(void)fd_close(self->store_fd);
	if (self->child.pid > 0)
		measure_stop(&self->child);
	if (self->socket_path[0] != '\0')
		(void)unlink(self->socket_path);
	free(self->payload);
	free(self->is_found);
	free(self->buffer);
	free(self);
}

/* It makes its socket some time after it has begun. */
static int dial(struct memcached *self, struct why *why)
{
	struct sockaddr_un address = { .sun_family = AF_UNIX };
	uint64_t end_ns = clock_now_ns() + START_NS;

	memcpy(address.sun_path, self->socket_path, sizeof(address.sun_path));
	self->fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
	if (self->fd < 0)
		return why_errno(why, -errno, "a socket");
	while (connect(self->fd, (struct sockaddr *)&address, sizeof(address)) < 0) {
		if (clock_now_ns() > end_ns || measure_was_cancelled())
			return lost(why);
		clock_pause_ns(2 * NS_PER_MS);
	}
	return 0;
}

static int launch(struct memcached *self, struct why *why)
{
	const struct contest_config *config = self->config;
	uint64_t bytes = config->memory_bytes;
	uint64_t item_bytes = MIB;
	char memory[32];
	char item[32];
	const char *argv[] = { "memcached", "-s",   self->socket_path,
			       "-m",        memory, "-I",
			       item,        "-t",   "2",
			       "-u",        "root", NULL };

	for (size_t i = 0; i < config->walk->read_count; i++)
		item_bytes = u64_max(
			item_bytes,
			config->walk->nodes[config->walk->node_memory[i]].payload_bytes + 512);
	item_bytes = bytes_round_up(item_bytes, MIB);
	if (bytes == 0)
		bytes = SPARE_FACTOR * config->walk->distinct_bytes + 256 * MIB;
	(void)snprintf(item, sizeof(item), "%llum", (unsigned long long)(item_bytes / MIB));
	/* It takes no items that are larger than half of its memory. */
	(void)snprintf(memory, sizeof(memory), "%llu",
		       (unsigned long long)u64_max(bytes / MIB, 2 * item_bytes / MIB));
	/* Who is not root need not say as whom it is to run. */
	if (geteuid() != 0)
		argv[9] = NULL;
	return measure_start(argv, &self->child, why);
}

static int memcached_open(const struct contest_config *config, void **ret_self, struct why *why)
{
	struct memcached *self;
	int r = 0;

	if (!measure_has_program("memcached"))
		return why_set(why, -ENOENT, "is not installed: apt-get install memcached");
	self = calloc(1, sizeof(*self));
	if (!self)
		return why_set(why, -ENOMEM, "out of memory");
	self->config = config;
	self->fd = -1;
	self->store_fd = open(config->walk->store, O_RDONLY | O_CLOEXEC);
	self->payload = malloc(STORE_PAYLOAD_BYTES_MAX + 2);
	self->is_found = calloc(config->walk->superblock.node_count, 1);
	self->buffer = malloc(BUFFER_BYTES);
	if (self->store_fd < 0)
		r = why_errno(why, -errno, "%s", config->walk->store);
	else if (!self->payload || !self->is_found || !self->buffer)
		r = why_set(why, -ENOMEM, "out of memory");
	else if (snprintf(self->socket_path, sizeof(self->socket_path), "%s/memcached-%d",
			  config->scratch, (int)getpid()) >= (int)sizeof(self->socket_path))
		r = why_set(why, -ENAMETOOLONG, "%s: too long for a socket; set TMPDIR",
			    config->scratch);
	if (r == 0)
		r = launch(self, why);
	if (r == 0)
		r = dial(self, why);
	if (r < 0)
		memcached_close(self);
	else
		*ret_self = self;
	return r;
}

const struct contestant contestant_memcached = { "memcached", memcached_open, memcached_frame,
						 memcached_forget, memcached_close };
