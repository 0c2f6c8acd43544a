/* SPDX-License-Identifier: MIT */
/**
 * residents.h - nodes that an administrator wants in the cache, whoever else wants them.
 *
 *	from     to       when
 *	NONE     WANTED   residents_pin
 *	WANTED   HELD     it is in the cache, or being read: it gets a hold
 *	HELD     WANTED   its segment is drained: it is read anew
 *	HELD     NONE     residents_unpin; or its read has failed: it is not tried again
 *	WANTED   NONE     residents_unpin
 *
 * An absent one is read as a prefetch is: when nobody waits for the disk.  What they take is bounded
 * by a share of the cache (RESIDENT_SHARE), so that the clients' sets always have the rest.
 *
 * Threads: loop thread.  Memory: none; all of it is in the nodes.
 */
#ifndef DAEMON_SHARING_RESIDENTS_H
#define DAEMON_SHARING_RESIDENTS_H

#include <stdint.h>

#include "daemon/cache/cache.h"
#include "daemon/sharing/queues.h"

struct residents {
	struct cache *cache;
	struct queues *queues;
	struct queue_entry queue_entry;
	uint64_t drain_count; /* of the cache, when holds in drained segments were last given up */
	struct queue_want asked; /* what the queue was given last */
	uint64_t
		retry_at_bytes; /* there was no room: until the cache has released so much; 0: there was */
};

/** Nodes and bytes that an order was about. */
struct residents_sum {
	uint32_t nodes;
	uint64_t bytes; /* of whole pages */
	uint32_t there; /* of the nodes: have a hold by now */
};

/** cache and queues outlive it. */
void residents_init(struct residents *residents, struct cache *cache, struct queues *queues);
void residents_done(struct residents *residents);

/**
 * Pins nodes with payload; those that are pinned already count as well.
 *
 * nodes:  NULL: all of the store.
 *
 * Returns: 0, or -ENOBUFS when they would take more than their share: then nothing has changed.
 */
int residents_pin(struct residents *residents, struct served *served, const uint32_t *nodes,
		  uint32_t node_count, struct residents_sum *ret, struct why *why);

/** Unpins nodes.  nodes: as above.  ret: of those that were pinned. */
void residents_unpin(struct residents *residents, struct served *served, const uint32_t *nodes,
		     uint32_t node_count, struct residents_sum *ret);

/** See fills_ended_fn. */
void residents_fill_ended(struct residents *residents, const struct fill_result *result);

/** Once a round: looks for room for those that had none. */
void residents_retry(struct residents *residents);

/** Bytes of all of them, there or not. */
uint64_t residents_bytes(const struct residents *residents);

#endif /* DAEMON_SHARING_RESIDENTS_H */
