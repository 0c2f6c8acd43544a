/* SPDX-License-Identifier: MIT */
#include "tools/bench/crowd/crowd_client.h"

#include <errno.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include "formats/base/bytes.h"
#include "formats/base/clock.h"
#include "formats/base/file.h"
#include "formats/base/random.h"
#include "formats/store/store_checksum.h"
#include "libclient/ooc/client.h"
#include "libclient/wire.h"
#include "tools/bench/crowd/crowd.h"

/* Payloads that are summed of each set, before and after it is settled. */
#define SUMS_BEFORE 2u
#define SUMS_AFTER  6u
/* An answer that takes longer is none. */
#define ANSWER_MS 30000
/* One set in so many is a stretch of neighbours that goes on where the last one was: a walk. */
#define WALK_SHARE  3u
#define PROBE_PAUSE (5 * NS_PER_MS)

struct crowd_client {
	const struct crowd_config *config;
	struct crowd_shared *shared;
	const char *socket_path;
	struct random random;
	struct ooc_client *client;
	struct ooc_store *store;
	struct ooc_want *wants;
	uint32_t *picks; /* of each want: its place in shared->nodes */
	size_t want_count;
	uint32_t walk_at;
	int echo_fd; /* of the prober */
};

static uint32_t below(struct crowd_client *self, uint32_t bound)
{
	return (uint32_t)(random_next(&self->random) % bound);
}

static void fail(struct crowd_client *self, const char *format, ...)
	__attribute__((format(printf, 2, 3)));
static void fail(struct crowd_client *self, const char *format, ...)
{
	char *text = self->shared->first_failure;
	va_list args;

	if (atomic_fetch_add(&self->shared->failed, 1) > 0)
		return;
	va_start(args, format);
	(void)vsnprintf(text, sizeof(self->shared->first_failure), format, args);
	va_end(args);
}

/* May the daemon be away at times? */
static bool may_be_lost(const struct crowd_client *self)
{
	return self->config->restart_s > 0;
}

static void lose(struct crowd_client *self, int error, const char *doing)
{
	if (!may_be_lost(self)) {
		fail(self, "%s: %s", doing,
		     self->client ? ooc_error_text(self->client) : strerror(-error));
		_exit(1);
	}
	atomic_fetch_add(&self->shared->lost, 1);
	clock_pause_ns(20 * NS_PER_MS);
}

static void connect_and_open(struct crowd_client *self)
{
	int r;

	for (;;) {
		r = ooc_connect(self->socket_path, "oocbench crowd", &self->client);
		if (r == 0)
			r = ooc_open(self->client, self->config->store, &self->store);
		if (r == 0)
			break;
		lose(self, r, "connecting");
		self->client = ooc_disconnect(self->client);
	}
	atomic_fetch_add(&self->shared->connected, 1);
}

/* ---- sums ---- */

static void sum_one(struct crowd_client *self, size_t want)
{
	struct crowd_shared *shared = self->shared;
	uint32_t pick = self->picks[want];
	uint32_t node = shared->nodes[pick];
	const struct store_node *record = &ooc_nodes(self->store)[node];
	struct ooc_place place;
	const void *payload;

	if (ooc_locate(self->store, node, &place) < 0)
		return;
	payload = ooc_map(self->store, node);
	if (!payload)
		return;
	atomic_fetch_add_explicit(&shared->reads, 1, memory_order_relaxed);
	if (store_checksum(payload, record->payload_bytes, record->payload_id) ==
	    shared->sums[pick])
		return;
	atomic_fetch_add(
		ooc_still_valid(self->store, node, &place) ? &shared->wrong : &shared->stale, 1);
}

static void sum_some(struct crowd_client *self, uint32_t count)
{
	for (uint32_t i = 0; i < count && self->want_count > 0; i++)
		sum_one(self, below(self, (uint32_t)self->want_count));
}

/* ---- sets ---- */

static void choose_set(struct crowd_client *self)
{
	uint32_t node_count = self->shared->node_count;
	uint32_t count = (uint32_t)u64_min(self->config->set_count, node_count);
	bool walks = below(self, WALK_SHARE) == 0;

	/* A third of it is new. */
	self->walk_at = (self->walk_at + count / 3) % node_count;
	for (uint32_t i = 0; i < count; i++) {
		self->picks[i] = walks ? (self->walk_at + i) % node_count : below(self, node_count);
		self->wants[i] = (struct ooc_want){
			.store = self->store,
			.node = self->shared->nodes[self->picks[i]],
			.importance = (float)(count - i),
		};
	}
	self->want_count = count;
}

static void count_refusals(struct crowd_client *self)
{
	for (size_t i = 0; i < self->want_count; i++) {
		enum ooc_reason reason = ooc_not_now(self->store, self->wants[i].node);

		if (reason == OOC_REASON_FULL)
			atomic_fetch_add(&self->shared->refused_full, 1);
		else if (reason == OOC_REASON_UNREADABLE && self->config->error_permille > 0)
			atomic_fetch_add(&self->shared->refused_unreadable, 1);
		else if (reason != OOC_REASON_NONE)
			fail(self, "node %u was refused with reason %u", self->wants[i].node,
			     (unsigned)reason);
	}
}

/* Returns: 0 when it is settled. */
static int settle(struct crowd_client *self)
{
	int r = ooc_wait(self->client, ANSWER_MS);

	if (r == -ETIMEDOUT)
		fail(self, "a set of %zu nodes is not answered within %d s", self->want_count,
		     ANSWER_MS / 1000);
	else if (r < 0)
		lose(self, r, "waiting for a set");
	return r;
}

static _Noreturn void client_run(struct crowd_client *self)
{
	connect_and_open(self);
	for (;;) {
		uint64_t end_ns = clock_now_ns() + NS_PER_S / self->config->sets_per_second;
		uint64_t now_ns;

		choose_set(self);
		if (ooc_visible_set(self->client, self->wants, self->want_count) < 0) {
			fail(self, "a set: %s", ooc_error_text(self->client));
			_exit(1);
		}
		sum_some(self, SUMS_BEFORE);
		if (settle(self) == 0) {
			count_refusals(self);
			atomic_fetch_add_explicit(&self->shared->sets, 1, memory_order_relaxed);
		}
		sum_some(self, SUMS_AFTER);
		now_ns = clock_now_ns();
		if (now_ns < end_ns)
			clock_pause_ns(end_ns - now_ns);
	}
}

/* ---- the prober ---- */

/* A process that sends back what it is sent, and does nothing else.  Returns: a socket to it, or -1. */
static int start_echo(void)
{
	static uint8_t bytes[WIRE_MESSAGE_BYTES_MAX];
	int fds[2];

	if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, fds) < 0)
		return -1;
	if (fork() == 0) {
		ssize_t n;

		(void)prctl(PR_SET_PDEATHSIG, SIGKILL);
		(void)fd_close(fds[0]);
		while ((n = recv(fds[1], bytes, sizeof(bytes), 0)) > 0)
			(void)send(fds[1], bytes, (size_t)n, MSG_NOSIGNAL);
		_exit(0);
	}
	(void)fd_close(fds[1]);
	return fds[0];
}

static double ms_since(uint64_t begin_ns)
{
	return (double)(clock_now_ns() - begin_ns) / (double)NS_PER_MS;
}

/* What an answer takes here and now of somebody who has nothing to do for it. */
static void ping(struct crowd_client *self)
{
	static uint8_t bytes[WIRE_MESSAGE_BYTES_MAX];
	size_t message_bytes =
		u64_min(sizeof(struct wire_set) + self->want_count * sizeof(struct wire_entry),
			sizeof(bytes));
	uint64_t begin_ns = clock_now_ns();
	uint32_t at = atomic_load(&self->shared->ping_count);

	if (at == CROWD_PROBES_MAX ||
	    send(self->echo_fd, bytes, message_bytes, MSG_NOSIGNAL) != (ssize_t)message_bytes ||
	    recv(self->echo_fd, bytes, sizeof(bytes), 0) <= 0)
		return;
	self->shared->ping_ms[at] = ms_since(begin_ns);
	atomic_store(&self->shared->ping_count, at + 1);
}

/* Nodes that lie in the cache now.  Returns: as many as a set has? */
static bool choose_resident(struct crowd_client *self)
{
	uint32_t node_count = self->shared->node_count;
	uint32_t at = below(self, node_count);

	self->want_count = 0;
	for (uint32_t i = 0; i < node_count && self->want_count < self->config->set_count; i++) {
		uint32_t pick = (at + i) % node_count;
		uint32_t node = self->shared->nodes[pick];

		if (ooc_node_state(self->store, node) != OOC_STATE_READY)
			continue;
		self->picks[self->want_count] = pick;
		self->wants[self->want_count] = (struct ooc_want){
			.store = self->store,
			.node = node,
			.importance = (float)(node_count - i),
		};
		self->want_count++;
	}
	return self->want_count == self->config->set_count;
}

static void probe(struct crowd_client *self)
{
	struct ooc_counters before;
	struct ooc_counters after;
	struct ooc_progress progress;
	uint64_t begin_ns;
	double ms;
	uint32_t at;

	if (!choose_resident(self))
		return;
	ping(self);
	ooc_counters(self->client, &before);
	begin_ns = clock_now_ns();
	if (ooc_visible_set(self->client, self->wants, self->want_count) < 0 || settle(self) < 0)
		return;
	ms = ms_since(begin_ns);
	ooc_counters(self->client, &after);
	ooc_progress(self->client, &progress);
	sum_some(self, SUMS_AFTER);
	/* Not all of it was there, or may be held, when the daemon came to it: that is another figure. */
	if (!progress.complete || after.fetched_bytes != before.fetched_bytes)
		return;
	at = atomic_load(&self->shared->probe_count);
	if (at == CROWD_PROBES_MAX)
		return;
	self->shared->probe_ms[at] = ms;
	atomic_store(&self->shared->probe_count, at + 1);
}

static _Noreturn void prober_run(struct crowd_client *self)
{
	self->echo_fd = start_echo();
	connect_and_open(self);
	for (;;) {
		int r = ooc_dispatch(self->client);

		if (r < 0)
			lose(self, r, "dispatching");
		else
			probe(self);
		clock_pause_ns(PROBE_PAUSE);
	}
}

/* ---- processes ---- */

static pid_t start(const struct crowd_config *config, const char *socket_path,
		   struct crowd_shared *shared, uint64_t seed,
		   void (*run)(struct crowd_client *self))
{
	struct crowd_client self = {
		.config = config,
		.shared = shared,
		.socket_path = socket_path,
		.random = { seed },
	};
	pid_t pid = fork();

	if (pid != 0)
		return pid < 0 ? -errno : pid;
	(void)prctl(PR_SET_PDEATHSIG, SIGKILL);
	(void)signal(SIGINT, SIG_DFL);
	(void)signal(SIGTERM, SIG_DFL);
	self.wants = calloc(config->set_count, sizeof(*self.wants));
	self.picks = calloc(config->set_count, sizeof(*self.picks));
	if (!self.wants || !self.picks)
		_exit(1);
	self.walk_at = below(&self, shared->node_count);
	run(&self);
	_exit(1);
}

pid_t crowd_client_start(const struct crowd_config *config, const char *socket_path,
			 struct crowd_shared *shared, uint64_t seed)
{
	return start(config, socket_path, shared, seed, client_run);
}

pid_t crowd_prober_start(const struct crowd_config *config, const char *socket_path,
			 struct crowd_shared *shared, uint64_t seed)
{
	return start(config, socket_path, shared, seed, prober_run);
}
