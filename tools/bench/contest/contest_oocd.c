/* SPDX-License-Identifier: MIT */
/*
 * Through a daemon of its own.  As a viewer does it: what the frame before has read is retired and the
 * next frame's set is said, then this one's nodes are read.
 */
#include <errno.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/clock.h"
#include "libclient/ooc/client.h"
#include "tools/bench/base/measure.h"
#include "tools/bench/contest/contest.h"

/** An answer that takes so long has something to say. */
#define WAIT_NS (30 * NS_PER_S)
/** Looks into shared memory before it sleeps: a set of what is there is answered within them. */
#define LOOK_NS (200 * NS_PER_US)

struct through {
	const struct contest_config *config;
	char scratch[PATH_MAX];
	struct measure_daemon daemon;
	struct ooc_client *client;
	struct ooc_store *store;
	struct ooc_want *wants;
	const void **payloads; /* of the frame */
	const struct contest_frame *said;
	int64_t serial;
};

static void through_stop(struct through *self)
{
	self->client = ooc_disconnect(self->client);
	self->store = NULL;
	self->said = NULL;
	if (self->daemon.child.pid > 0)
		measure_daemon_stop(&self->daemon);
	if (self->scratch[0] != '\0')
		measure_scratch_remove(self->scratch);
	self->scratch[0] = '\0';
}

static int through_start(struct through *self, struct why *why)
{
	const struct contest_walk *walk = self->config->walk;
	uint64_t cache_bytes = self->config->memory_bytes;
	int r = measure_scratch_make(NULL, self->scratch, why);

	if (r < 0)
		return r;
	/* Payloads begin on pages. */
	if (cache_bytes == 0)
		cache_bytes = bytes_round_up(walk->distinct_bytes +
						     walk->superblock.node_count * 4096 + 64 * MIB,
					     64 * MIB);
	r = measure_daemon_start(self->scratch, cache_bytes, 0, &self->daemon, why);
	if (r < 0)
		return r;
	r = ooc_connect(self->daemon.socket_path, "oocbench", &self->client);
	if (r < 0)
		return why_set(why, r, "%s", ooc_error_text(NULL));
	r = ooc_open(self->client, walk->store, &self->store);
	if (r < 0)
		return why_set(why, r, "%s: %s", walk->store, ooc_error_text(self->client));
	ooc_keep_drawing(self->client, true);
	return 0;
}

static void through_close(void *arg)
{
	struct through *self = arg;

	through_stop(self);
	free(self->wants);
	free(self->payloads);
	free(self);
}

static int through_open(const struct contest_config *config, void **ret_self, struct why *why)
{
	struct through *self = calloc(1, sizeof(*self));
	size_t count = 0;
	int r;

	if (!self)
		return why_set(why, -ENOMEM, "out of memory");
	self->config = config;
	for (size_t i = 0; i < config->walk->frame_count; i++)
		count = u64_max(count, config->walk->frames[i].node_count);
	self->wants = calloc(count + 1, sizeof(*self->wants));
	self->payloads = calloc(count + 1, sizeof(*self->payloads));
	r = self->wants && self->payloads ? through_start(self, why)
					  : why_set(why, -ENOMEM, "out of memory");
	if (r < 0)
		through_close(self);
	else
		*ret_self = self;
	return r;
}

static int say(struct through *self, const struct contest_frame *frame, struct why *why)
{
	for (size_t i = 0; i < frame->node_count; i++)
		self->wants[i] = (struct ooc_want){
			.store = self->store,
			.node = frame->nodes[i],
			.importance = (float)(frame->node_count - i),
		};
	self->serial = ooc_visible_set(self->client, self->wants, frame->node_count);
	self->said = frame;
	return self->serial < 0
		       ? why_set(why, (int)self->serial, "%s", ooc_error_text(self->client))
		       : 0;
}

/* Finds those nodes, from `from` on, that are there in order.  Returns: the first that is not. */
static size_t find_some(struct through *self, const struct contest_frame *frame, size_t from)
{
	for (size_t i = from; i < frame->node_count; i++) {
		self->payloads[i] = ooc_map(self->store, frame->nodes[i]);
		if (!self->payloads[i])
			return i;
	}
	return frame->node_count;
}

/* Until something has changed, or may have. */
static int pause_for(struct through *self, uint32_t node, uint64_t begin_ns, struct why *why)
{
	struct pollfd fd = { .fd = ooc_fd(self->client), .events = POLLIN };
	uint64_t waited_ns = clock_now_ns() - begin_ns;
	int r;

	if (waited_ns < LOOK_NS)
		return 0;
	if (waited_ns > WAIT_NS)
		return why_set(why, -ETIMEDOUT, "node %u does not come", node);
	ooc_notify(self->client, true);
	if (poll(&fd, 1, 100) < 0 && errno != EINTR)
		return why_errno(why, -errno, "waiting for the daemon");
	r = ooc_dispatch(self->client);
	if (r < 0)
		return why_set(why, r, "%s", ooc_error_text(self->client));
	if (ooc_not_now(self->store, node) != OOC_REASON_NONE)
		return why_set(why, -ENOBUFS, "node %u is answered \"not now\"", node);
	return 0;
}

static int through_frame(void *arg, const struct contest_frame *frame,
			 const struct contest_frame *next, struct contest_touch *touch,
			 struct why *why)
{
	struct through *self = arg;
	uint64_t begin_ns = clock_now_ns();
	size_t found_count = 0;
	int r = self->said == frame ? 0 : say(self, frame, why);

	while (r == 0) {
		found_count = find_some(self, frame, found_count);
		if (found_count == frame->node_count)
			break;
		r = pause_for(self, frame->nodes[found_count], begin_ns, why);
	}
	if (r == 0)
		ooc_notify(self->client, false);
	/* One after the other, so that the daemon is woken once for both. */
	if (r == 0 && next)
		r = ooc_retire(self->client, self->serial);
	if (r == 0 && next)
		r = say(self, next, why);
	for (size_t i = 0; r == 0 && i < frame->node_count; i++)
		contest_touch(touch, self->payloads[i],
			      self->config->walk->nodes[frame->nodes[i]].payload_bytes);
	return r;
}

/* Lets go of everything and has it evicted: the daemon runs on, as it does for years. */
static int through_forget(void *arg, struct why *why)
{
	struct through *self = arg;
	const struct contest_walk *walk = self->config->walk;
	char *text = NULL;
	int64_t serial = ooc_visible_set(self->client, NULL, 0);
	int r = serial < 0 ? (int)serial : ooc_wait(self->client, 1000);

	self->said = NULL;
	if (r == 0)
		r = ooc_retire(self->client, serial);
	if (r == 0)
		r = ooc_steer(self->client, OOC_EVICT, NULL, NULL, 0, &text);
	free(text);
	if (r < 0)
		return why_set(why, r, "%s", ooc_error_text(self->client));
	for (size_t i = 0; i < walk->read_count; i++)
		if (ooc_node_state(self->store, walk->node_memory[i]) != OOC_STATE_ABSENT)
			return why_set(why, -EBUSY, "node %u is still in the cache",
				       walk->node_memory[i]);
	return 0;
}

const struct contestant contestant_oocd = { "oocd", through_open, through_frame, through_forget,
					    through_close };
