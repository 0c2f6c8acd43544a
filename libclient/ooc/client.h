/* SPDX-License-Identifier: MIT */
/**
 * client.h - look at stores through the cache that all programs of a machine share.
 *
 *	ooc_connect -> ooc_open -> { ooc_visible_set, ooc_map or ooc_wait } -> ooc_close
 *
 * Each frame a viewer says which nodes it wants, most important first, and draws those that are
 * drawable, straight out of the daemon's memory.  Asking costs one message where the set has
 * changed, nothing where it has not; looking costs no system call; nobody waits for the disk.  The
 * library reads no disk, draws nothing and starts no thread.
 *
 * Rules:
 *
 *   1. A set replaces the set before it.  What is in it is held: it stays where it is.  What dropped
 *      out is given back when the client says that it draws it no longer, which the next
 *      ooc_visible_set() says unless ooc_keep_drawing() was called.
 *   2. A pointer from ooc_map() is good until the next ooc_visible_set(), ooc_dispatch() or
 *      ooc_wait(): map again after each, it costs next to nothing.  With ooc_keep_drawing() it is
 *      good until ooc_retire() is called with a set that was given after it was mapped.
 *   3. Losing the daemon loses nothing that is drawable.  The library reconnects, opens its stores
 *      and says the set again by itself; until then nothing new becomes drawable.  Only a client
 *      that was itself away for long (stopped, suspended) may find that the daemon has given its
 *      memory to others meanwhile: ooc_still_valid() tells, after a copy or a draw.
 *
 * Threads: a client and its stores belong to one thread, but for ooc_map(), ooc_locate(),
 *	ooc_still_valid() and the functions that read the HS, which render threads may call while the
 *	owner calls none of ooc_open, ooc_close, ooc_visible_set, ooc_dispatch, ooc_wait.  Several
 *	clients in one process are independent.
 * Errors: 0 or more, or a negative errno; ooc_error_text() has the reason of a client's last one.
 * Memory: structs returned by pointer are the library's, given back as each function says.
 */
#ifndef OOC_CLIENT_H
#define OOC_CLIENT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "formats/store/layout.h"
#include "formats/store/payload_layout.h"

#ifdef __cplusplus
extern "C" {
#endif

#define OOC_API __attribute__((visibility("default")))

struct ooc_client;
struct ooc_store;

/**
 * Connects to the daemon.
 *
 * socket_path:  NULL: the running daemon's usual places ($OOCD_SOCKET, else /run/oocd/oocd.sock, then
 *               $XDG_RUNTIME_DIR/oocd.sock or /tmp/oocd-UID/oocd.sock); where nobody listens, a
 *               daemon is started for this user, which ends when it has been idle for a minute.
 * name:         of the program, for `oocctl status`; at most 63 bytes count.
 *
 * Returns: 0, or
 *	-ECONNREFUSED  nobody listens at socket_path, or the daemon that was started has ended
 *	-ENOENT   nothing is at socket_path, or no oocd is found to be started
 *	-EACCES   the socket is not for this user, or lies where others could have put it
 *	-EPROTONOSUPPORT  the daemon speaks another version of the protocol
 *	-EPROTO, -ETIMEDOUT  whoever listens there is no daemon
 *	-ENAMETOOLONG, -ENOMEM or -errno.
 * May block: for some seconds while a daemon starts.
 * Ownership: *ret is the caller's, ended with ooc_disconnect(); on failure it is NULL.
 */
OOC_API int ooc_connect(const char *socket_path, const char *name, struct ooc_client **ret);

/**
 * The same, for programs that know what daemon they need where none runs.
 *
 * daemon_options:  of oocd, as on its command line: { "--cache-size", "64M", NULL }; at most 16, copied.
 *                  A daemon that runs already stays as it is.  NULL: none.
 *
 * Returns: as ooc_connect(); also -E2BIG (too many options).
 */
OOC_API int ooc_connect_or_start(const char *socket_path, const char *name,
				 const char *const *daemon_options, struct ooc_client **ret);

/** Closes all stores, gives everything back.  NULL is allowed.  Returns: NULL. */
OOC_API struct ooc_client *ooc_disconnect(struct ooc_client *client);

/** Reason of the last failure of a function of this client, one line; NULL: of ooc_connect(). */
OOC_API const char *ooc_error_text(const struct ooc_client *client);

/**
 * Descriptor that becomes readable when ooc_dispatch() has something to do; see ooc_notify().
 *
 * Returns: it, or -1 while the daemon is away: then call ooc_dispatch() now and again.  It may change
 *	with each ooc_dispatch().
 */
OOC_API int ooc_fd(const struct ooc_client *client);

/**
 * Shall ooc_fd() become readable when nodes of the set have become drawable, and when it is settled?
 * For programs that sleep until there is something to draw.  Off at first: who draws frame after
 * frame sees it in shared memory, and would get messages for nothing.
 */
OOC_API void ooc_notify(struct ooc_client *client, bool notify);

/**
 * Takes what the daemon has sent; reconnects if it was lost (at most one quick try a call, and a
 * daemon of the user's own is started again).
 *
 * Returns: 0; -ENOTCONN while the daemon is away: keep drawing, call again next frame; -ESTALE, once,
 *	when the daemon serves one of the stores no longer: ooc_store_error() tells which.
 * May block: no.
 */
OOC_API int ooc_dispatch(struct ooc_client *client);

/**
 * Opens a store.  The file is opened here, with this process's rights, and its descriptor passed.
 *
 * Returns: 0, -ENOENT, -EACCES, -EUCLEAN (not a store, or damaged), -ENOTCONN, -ETIMEDOUT,
 *	-EMFILE (64 stores are open), -ENOMEM or -errno.  Waits for the daemon's answer.
 *	ooc_error_text() does not name the path: put it in front.
 * Ownership: ended with ooc_close(), or with its client.
 */
OOC_API int ooc_open(struct ooc_client *client, const char *path, struct ooc_store **ret);
OOC_API struct ooc_store *ooc_close(struct ooc_store *store);

/**
 * Why a store is no longer served, after the daemon was lost and has come back.  What was drawable
 * stays so, and the HS stays as it is; nothing new becomes drawable until it is closed and opened.
 *
 * Returns: 0, -ESTALE (the file has another generation now, whose nodes have other numbers), or what
 *	ooc_open() would return.
 */
OOC_API int ooc_store_error(const struct ooc_store *store);

/** The store's superblock and HS: node_count records, read-only, valid until ooc_close(). */
OOC_API const struct store_superblock *ooc_superblock(const struct ooc_store *store);
OOC_API const struct store_node *ooc_nodes(const struct ooc_store *store);
OOC_API uint64_t ooc_node_count(const struct ooc_store *store);

/** One wanted node. */
struct ooc_want {
	struct ooc_store *store;
	uint32_t node;    /* index of its HS record; one with a payload */
	float importance; /* >= 0, larger first; compared between clients as well */
};

/**
 * Says which nodes are wanted from now on.
 *
 * wants:  in descending importance, of any open stores of this client.  Copied.  A node given twice
 *         counts once.
 *
 * A set equal to the one before, importances included, sends nothing and has its serial.  While one set is unanswered the newest of those
 * given since waits in the library and goes out with the next ooc_dispatch() after the answer.
 *
 * Returns: the set's serial (> 0, larger than that of any other set before), or -EINVAL (a node that
 *	is none or has nothing to draw; an importance that is none or does not descend), -E2BIG (more
 *	than 2^20 nodes), -ENOMEM: then the set before stays.  A lost daemon is no error: the set is
 *	said again on reconnection.
 * Cost: O(count); one system call for each 5,459 nodes where something changed.  May block: no.
 */
OOC_API int64_t ooc_visible_set(struct ooc_client *client, const struct ooc_want *wants,
				size_t count);

/**
 * From now on what sets drop is given back by ooc_retire() only: for programs that draw in other
 * threads than the one that asks.
 *
 * When others need room the daemon asks for what is held beyond this client's share.  The next set is
 * then a new one, even if it equals the one before: so give one, and retire it, when ooc_fd() has
 * become readable.  (Without this function ooc_dispatch() answers by itself.)  Who does not for seconds
 * is disconnected, and connects again.
 */
OOC_API void ooc_keep_drawing(struct ooc_client *client, bool keep);

/**
 * Nothing of sets before `serial` that is not in it is drawn any longer.  Call it when the draws of a
 * frame that used that set have begun and those of all frames before have ended.
 *
 * Returns: 0, or -EINVAL (no such set was given).  May block: no.
 */
OOC_API int ooc_retire(struct ooc_client *client, int64_t serial);

/**
 * The node's payload, or NULL while it is not drawable.  No system call.
 *
 * Returns: ooc_nodes(store)[node].payload_bytes bytes, page-aligned, valid and unchanging as rule 2
 *	says; judged by the daemon, so that indices, runs and streams need no check.
 */
OOC_API const void *ooc_map(const struct ooc_store *store, uint32_t node);

/** Where a drawable node's payload lies, for programs that make GPU buffers of whole segments. */
struct ooc_place {
	uint32_t segment; /* a small number for ooc_segment(), < 4096 */
	uint64_t offset_bytes;
	uint64_t fill; /* differs for each filling of the node: what was copied is still the same */
};

/** Returns: 0, or -EAGAIN while the node is not drawable. */
OOC_API int ooc_locate(const struct ooc_store *store, uint32_t node, struct ooc_place *ret);

/** Was the payload at `place` there, unchanged, all the while until now?  No system call. */
OOC_API bool ooc_still_valid(const struct ooc_store *store, uint32_t node,
			     const struct ooc_place *place);

/**
 * A segment's mapping, read-only, good as long as a pointer from ooc_map() into it is.  Segments come
 * and go; `unique` differs for each that ever was.
 *
 * Returns: 0, or -ENOENT where there is none of that number.
 */
OOC_API int ooc_segment(const struct ooc_store *store, uint32_t segment, const void **ret_base,
			uint64_t *ret_bytes, uint64_t *ret_unique);

/** Why a node of the set is not coming for now. */
enum ooc_reason {
	OOC_REASON_NONE = 0,       /* it is here, on its way, or not in the set */
	OOC_REASON_FULL = 1,       /* more is wanted than fits: ask for less, or draw in portions */
	OOC_REASON_DAMAGED = 2,    /* the store is damaged there */
	OOC_REASON_UNREADABLE = 3, /* the device failed */
	OOC_REASON_NO_MEMORY = 4,  /* the daemon is short of memory */
	OOC_REASON_LOST = 5,       /* ooc_store_error() says why */
};

/** No system call; what ooc_dispatch() has brought counts. */
OOC_API enum ooc_reason ooc_not_now(const struct ooc_store *store, uint32_t node);

/** Where a node's payload is, whoever wanted it.  For looking at the cache; ooc_map() is for drawing. */
enum ooc_state {
	OOC_STATE_ABSENT = 0, /* on the disk only */
	OOC_STATE_BUSY = 1,   /* being read */
	OOC_STATE_READY = 2,  /* in the cache */
	OOC_STATE_DAMAGED = 3,
};

/** No system call.  While the daemon is away: as it was. */
OOC_API enum ooc_state ooc_node_state(const struct ooc_store *store, uint32_t node);

/** How far the newest set is. */
struct ooc_progress {
	int64_t serial; /* of the newest set given to ooc_visible_set() */
	bool settled;   /* each of its nodes is drawable or was answered "not now" */
	bool complete;  /* each of them is drawable */
	size_t want_count;
	size_t drawable_count;
	size_t refused_count;
};

/** No system call; what ooc_dispatch() has brought counts.  Cost: O(nodes of the set). */
OOC_API void ooc_progress(const struct ooc_client *client, struct ooc_progress *ret);

/**
 * Waits until the newest set is settled, dispatching meanwhile.
 *
 * timeout_ms:  < 0: for ever.
 *
 * Returns: 0 (ooc_progress() says whether it is complete as well), -ETIMEDOUT, or -ENOTCONN when the daemon is away and does not come back in time.
 */
OOC_API int ooc_wait(struct ooc_client *client, int timeout_ms);

/**
 * Asks for nodes that may be wanted soon, nearest in time first.  Never delays anyone's set, holds
 * nothing; replaces what was asked for before and is still queued.
 *
 * wants:  as for ooc_visible_set(); at most the first 5,459 count.
 *
 * Returns: 0, -EINVAL, -E2BIG, -EAGAIN (the daemon is behind: ask again) or -ENOTCONN.
 * May block: no.
 */
OOC_API int ooc_prefetch(struct ooc_client *client, const struct ooc_want *wants, size_t count);

/**
 * The daemon's status as JSON (`oocctl status --json` prints it).
 *
 * Returns: 0, -ENOTCONN, -ETIMEDOUT or -ENOMEM.  Waits for the answer.
 * Ownership: *ret is given back with free().
 */
OOC_API int ooc_status(struct ooc_client *client, char **ret);

/**
 * The daemon's counters as OpenMetrics text: sums over all stores and clients (`oocctl metrics`).
 *
 * Returns and ownership: as ooc_status().
 */
OOC_API int ooc_metrics(struct ooc_client *client, char **ret);

/** What an administrator (root, the daemon's user, its group of administrators) may order. */
enum ooc_order {
	OOC_EVICT = 1,  /* out of the cache, where nobody holds them */
	OOC_PIN = 2,    /* into the cache, to stay there, within a share of it that is for that */
	OOC_UNPIN = 3,  /* they may go again */
	OOC_RELOAD = 4, /* the daemon reads its configuration anew */
};

/** Nodes that one order may name. */
#define OOC_ORDER_NODE_COUNT_MAX 16378u

/**
 * Gives the daemon an order.
 *
 * store:  open; NULL for OOC_RELOAD, and for OOC_EVICT and OOC_UNPIN of all that is served.
 * nodes:  node_count indices of nodes with payload; none: all of the store.
 * ret:    what was done, as a JSON object.
 *
 * Returns: 0, -EACCES (not an administrator), -EINVAL (a store is missing or too much, or a node has
 *	nothing to draw), -E2BIG (too many nodes), -ENOBUFS (more than may be pinned), -EOPNOTSUPP (there
 *	is no configuration to read), -ENOTCONN, -ETIMEDOUT, -ENOMEM or another -errno of the daemon's.
 *	Waits for the answer.
 * Ownership: *ret is given back with free().
 */
OOC_API int ooc_steer(struct ooc_client *client, enum ooc_order order, struct ooc_store *store,
		      const uint32_t *nodes, size_t node_count, char **ret);

/** What the daemon knows of a node's payload, beyond ooc_node_state(). */
struct ooc_node_info {
	enum ooc_state state;
	uint64_t
		replaced; /* where nobody holds it: of two nodes the one with the smaller goes first; else 0 */
	uint32_t holds; /* of clients; a pin counts as one */
	uint32_t payer; /* session, as in the status, for which it was read; 0: none */
	double age_s; /* since it came, or, OOC_STATE_ABSENT, since it was evicted; < 0: never there */
	bool pinned;
	bool unused_prefetch; /* a prefetch brought it and nobody has used it */
};

/** Nodes that ooc_inspect() tells of at one time. */
#define OOC_INSPECT_COUNT_MAX 1024u

/**
 * Asks about the nodes first, first + 1, ... of a store.  For looking at the cache.
 *
 * ret:  OOC_INSPECT_COUNT_MAX.
 *
 * Returns: how many there are in ret, fewer only at the store's end; -ENOTCONN, -ETIMEDOUT or -errno.
 *	Waits for the answer.
 */
OOC_API int ooc_inspect(struct ooc_store *store, uint32_t first, struct ooc_node_info *ret);

/** What this client has caused and seen, since it connected. */
struct ooc_counters {
	uint64_t sets_sent;
	uint64_t messages_sent;
	uint64_t reconnects;
	/* As the daemon says in shared memory; 0 again after a reconnection. */
	uint64_t fetched_bytes;    /* read for this client's sets */
	uint64_t prefetched_bytes; /* read for its prefetches */
	uint64_t cache_bytes;      /* what the daemon may use for all stores */
	uint64_t cache_used_bytes; /* and does */
};

/** No system call. */
OOC_API void ooc_counters(const struct ooc_client *client, struct ooc_counters *ret);

#ifdef __cplusplus
}
#endif

#endif /* OOC_CLIENT_H */
