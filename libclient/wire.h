/* SPDX-License-Identifier: MIT */
/**
 * wire.h - what clients and daemon say to each other, and what they share.
 *
 * libclient/PROTOCOL.md is the specification: who says what when.  Here are the bytes: messages on a
 * SOCK_SEQPACKET socket, one struct a message, and three kinds of shared memory that the daemon
 * writes and clients map read-only.  Nothing is written by clients to shared memory.
 *
 * A message is wire_header, a fixed body, and for some types an array.  wire_check() judges a
 * received datagram as a whole; after that its fields may be read where they lie.  What is right
 * only beside earlier messages (is this store open? does the importance still descend?) is the
 * receiver's to judge.
 *
 * Threads: any; pure functions.
 */
#ifndef LIBCLIENT_WIRE_H
#define LIBCLIENT_WIRE_H

#include <assert.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "formats/base/why.h"

#define WIRE_VERSION 1u
/** Larger datagrams fail at default socket buffers. */
#define WIRE_MESSAGE_BYTES_MAX 65536u
#define WIRE_NAME_BYTES        64u
#define WIRE_PATH_BYTES        1024u
#define WIRE_FD_COUNT_MAX      3u
/** Stores that one session may have open. */
#define WIRE_STORE_COUNT_MAX 64u
/** Nodes in one set, over all its messages. */
#define WIRE_SET_NODE_COUNT_MAX (1u << 20)

enum wire_type {
	/* client to daemon */
	WIRE_HELLO = 1,    /* first of all; answered by WELCOME or ERROR */
	WIRE_OPEN = 2,     /* + the store's descriptor; answered by OPENED or ERROR */
	WIRE_CLOSE = 3,    /* not answered */
	WIRE_SET = 4,      /* answered in the session page, and by EVENT where asked for */
	WIRE_RETIRE = 5,   /* not answered */
	WIRE_PREFETCH = 6, /* not answered */
	WIRE_STATUS = 7,   /* answered by TEXT, NODES or ERROR */
	WIRE_ADMIN = 8,    /* answered by TEXT or ERROR */
	WIRE_LISTEN = 9,   /* answered by EVENT */
	/* daemon to client */
	WIRE_WELCOME = 64, /* + session page */
	WIRE_OPENED = 65,  /* + HS, directory, grants */
	WIRE_SEGMENT = 66, /* + the segment; before any node in it is READY */
	WIRE_SEGMENT_GONE = 67,
	WIRE_EVENT = 68,
	WIRE_NOT_NOW = 69,
	WIRE_TEXT = 70,
	WIRE_ERROR = 71,
	WIRE_NODES = 72,
	WIRE_RECALL = 73,
};

struct wire_header {
	uint16_t type;     /* enum wire_type */
	uint16_t reserved; /* 0 */
	uint32_t bytes;    /* of the whole message, header included */
};

struct wire_hello {
	struct wire_header header;
	uint32_t version; /* WIRE_VERSION */
	uint32_t reserved;
	char name[WIRE_NAME_BYTES]; /* for people: the program; NUL-padded */
};

struct wire_welcome {
	struct wire_header header;
	uint32_t version;
	uint32_t session;
	uint64_t epoch; /* another one: the daemon was restarted */
	uint64_t page_bytes;
};

/** The client numbers its stores: 0 .. WIRE_STORE_COUNT_MAX - 1, free again after CLOSE. */
struct wire_open {
	struct wire_header header;
	uint32_t store;
	uint32_t reserved;
	char path[WIRE_PATH_BYTES]; /* for people: what status shows; NUL-padded; never opened */
};

struct wire_opened {
	struct wire_header header;
	uint32_t store;
	uint32_t segment_bytes_log2; /* size of every segment of this store's arena */
	uint64_t generation;
	uint64_t node_count;
	uint8_t uuid[16];
	/* Lengths that may be mapped: at least what is said here, and each file is as long or longer. */
	uint64_t hs_bytes;        /* a store_superblock, then node_count store_nodes */
	uint64_t directory_bytes; /* struct wire_directory, node_count words */
	uint64_t grants_bytes;    /* struct wire_grants, one word for each 64 nodes */
};

struct wire_close {
	struct wire_header header;
	uint32_t store;
	uint32_t reserved;
};

struct wire_entry {
	uint32_t store;
	uint32_t node;
	float importance; /* >= 0; the array is in descending order of it */
};

enum wire_set_flag {
	WIRE_SET_FIRST = 1,  /* the set begins with this message; one begun before is forgotten */
	WIRE_SET_LAST = 2,   /* and ends with it: now it replaces the set before */
	WIRE_SET_RETIRE = 4, /* what earlier sets had and this one has not is no longer drawn */
	WIRE_SET_EVENTS = 8, /* tell by EVENT when nodes become ready and when it is settled */
	WIRE_SET_FLAGS_ALL = 15,
};

struct wire_set {
	struct wire_header header;
	uint64_t serial; /* > 0, the same in all its messages, above those of all sets before */
	uint32_t flags;  /* enum wire_set_flag */
	uint32_t entry_count;
	struct wire_entry entries[];
};

/** Sets before `serial` are no longer drawn: what neither it nor a later set has is given back. */
/** The header alone. */
struct wire_listen {
	struct wire_header header;
};

struct wire_retire {
	struct wire_header header;
	uint64_t serial;
};

/** Replaces the prefetches asked for before that are still queued. */
struct wire_prefetch {
	struct wire_header header;
	uint32_t entry_count;
	uint32_t reserved;
	struct wire_entry entries[];
};

enum wire_status_what {
	WIRE_STATUS_ALL = 1,     /* JSON, as `oocctl status --json` prints it */
	WIRE_STATUS_METRICS = 2, /* OpenMetrics text */
	WIRE_STATUS_NODES = 3,   /* states of nodes, from `first` on: answered by NODES */
	WIRE_STATUS_COUNT_
};

/** A question.  One at a time: the next one when the answer has come whole. */
struct wire_status {
	struct wire_header header;
	uint32_t what;  /* enum wire_status_what */
	uint32_t store; /* of NODES: an open one; else 0 */
	uint32_t first; /* of NODES: a node of it; else 0 */
	uint32_t reserved;
};

enum wire_admin_what {
	WIRE_ADMIN_EVICT = 1, /* out of the cache, where nobody holds them */
	WIRE_ADMIN_PIN = 2,   /* into the cache, to stay there until */
	WIRE_ADMIN_UNPIN = 3,
	WIRE_ADMIN_RELOAD = 4, /* the configuration */
	WIRE_ADMIN_COUNT_
};

/** In wire_admin.store: all that the daemon serves. */
#define WIRE_STORE_ALL UINT32_MAX

/** An order to the daemon, from root, its own user or the group that may. */
struct wire_admin {
	struct wire_header header;
	uint32_t what;  /* enum wire_admin_what */
	uint32_t store; /* an open one; EVICT, UNPIN: or WIRE_STORE_ALL; RELOAD: 0 */
	uint32_t node_count;
	uint32_t reserved;
	uint32_t nodes[]; /* none: all of the store */
};

/**
 * The daemon takes segment numbers in turn and one again only after all the others, so that a client
 * that has yet to read of a new segment cannot mistake an old one for it: before so many
 * announcements have piled up unread, it has been dropped.
 */
struct wire_segment {
	struct wire_header header;
	uint32_t store;
	uint32_t segment;
	uint64_t segment_bytes;
};

struct wire_segment_gone {
	struct wire_header header;
	uint32_t store;
	uint32_t segment;
};

struct wire_event {
	struct wire_header header;
	uint64_t serial;        /* newest acknowledged set */
	uint32_t settled;       /* every node of it is drawable or was answered "not now" */
	uint32_t complete;      /* settled, and no node was answered "not now" */
	uint64_t missing_count; /* nodes of it that are still on their way */
};

/**
 * Others need room: say the set again, so that what this client holds and may not keep is given back.
 * Whoever does not is disconnected after a while.
 */
struct wire_recall {
	struct wire_header header;
	uint64_t serial; /* newest acknowledged set; 0: none */
};

/** Why a node of a set is not coming for now.  Also OOC_NOT_NOW_* of the public header. */
enum wire_reason {
	WIRE_REASON_NONE = 0,
	WIRE_REASON_FULL = 1,       /* the set is larger than what this client may hold */
	WIRE_REASON_DAMAGED = 2,    /* checksum or structure wrong */
	WIRE_REASON_UNREADABLE = 3, /* the device failed, after retries */
	WIRE_REASON_NO_MEMORY = 4,  /* the daemon is short of memory */
	WIRE_REASON_COUNT_
};

struct wire_refusal {
	uint32_t store;
	uint32_t node;
	uint32_t reason; /* enum wire_reason */
};

/** Speaks of one set only: what the next set wants as well is refused again, or is on its way. */
struct wire_not_now {
	struct wire_header header;
	uint64_t serial;
	uint32_t entry_count;
	uint32_t reserved;
	struct wire_refusal entries[];
};

struct wire_text {
	struct wire_header header;
	uint32_t last; /* 1: the answer ends with this message */
	uint32_t text_bytes;
	char text[]; /* a piece, not NUL-terminated */
};

struct wire_error {
	struct wire_header header;
	int32_t error;    /* negative errno */
	uint32_t type;    /* of the message that it answers */
	uint32_t store;   /* of an OPEN */
	uint32_t version; /* of the daemon */
	char text[WHY_TEXT_BYTES];
};

/** Where a payload is, to those who look: the directory's states, and whether anybody counts on it. */
enum wire_cached {
	WIRE_CACHED_ABSENT = 0,
	WIRE_CACHED_BUSY = 1,
	WIRE_CACHED_HELD = 2,
	WIRE_CACHED_FREE = 3,
	WIRE_CACHED_DAMAGED = 4,
	WIRE_CACHED_COUNT_
};

enum wire_node_flag {
	WIRE_NODE_UNUSED_PREFETCH = 1, /* a prefetch brought it in, and nobody has used it since */
	WIRE_NODE_PINNED = 2,          /* WIRE_ADMIN_PIN */
	WIRE_NODE_FLAGS_ALL = 3,
};

#define WIRE_AGE_NEVER UINT32_MAX

struct wire_node {
	uint64_t order; /* FREE: of two nodes the one with the smaller goes first; else 0 */
	uint32_t
		age_ds; /* tenths of a second: since it came, ABSENT: since it went; or WIRE_AGE_NEVER */
	uint32_t holds;  /* of clients, and one if it is pinned */
	uint32_t payer;  /* session that had it read; 0: none */
	uint16_t cached; /* enum wire_cached */
	uint16_t flags;  /* enum wire_node_flag */
};

struct wire_nodes {
	struct wire_header header;
	uint32_t store;
	uint32_t first;
	uint32_t
		entry_count; /* of nodes first, first + 1, ...; less than fits: these were the last */
	uint32_t reserved;
	struct wire_node entries[];
};

/* ---- shared memory: written by the daemon, read-only to clients ---- */

/** One page a session. */
struct wire_session_page {
	_Atomic uint64_t epoch;        /* 0 once the session is over */
	_Atomic uint64_t acknowledged; /* serial of the newest set taken over */
	_Atomic uint64_t settled;      /* serial of the newest set that is settled */
	_Atomic uint64_t complete;     /* serial of the newest set settled without "not now" */
	/* For people and statistics; written when the daemon has time. */
	_Atomic uint64_t fetched_bytes;    /* payload bytes read since WELCOME for its sets */
	_Atomic uint64_t prefetched_bytes; /* payload bytes read since WELCOME for its prefetches */
	_Atomic uint64_t cache_bytes;      /* --cache-size */
	_Atomic uint64_t cache_used_bytes; /* of it BUSY, HELD and FREE: all stores, all clients */
	/* Messages sent to this client, WELCOME included: who has taken as many need not look for one. */
	_Atomic uint64_t message_count;
	/* Another value every WIRE_BEAT_MS while the daemon lives. */
	_Atomic uint64_t beat;
};

/** One a store and generation: where every node is.  Then node_count words. */
struct wire_directory {
	uint64_t generation;
	uint64_t node_count;
	/* Another one, or 0, before a daemon evicts anything that sessions of the old one may draw. */
	_Atomic uint64_t epoch;
	uint64_t reserved[5];
	_Atomic uint64_t words[];
};

enum wire_node_state {
	WIRE_NODE_ABSENT = 0,
	WIRE_NODE_BUSY = 1,
	WIRE_NODE_READY = 2,
	WIRE_NODE_DAMAGED = 3,
};

#define WIRE_PAGE_BYTES        4096u
#define WIRE_BEAT_MS           250u
#define WIRE_SEGMENT_PAGES_MAX (1u << 16)
#define WIRE_SEGMENT_COUNT_MAX (1u << 12)

/*
 * A directory word: bits 0-1 state, 2-17 first page in the segment, 18-29 segment, 30-63 fill count,
 * which grows with every fill of the node: two equal words with READY mean the same bytes.
 */
static inline uint64_t wire_word(enum wire_node_state state, uint32_t segment, uint32_t page,
				 uint64_t fill_count)
{
	return (uint64_t)state | (uint64_t)page << 2 | (uint64_t)segment << 18 | fill_count << 30;
}

static inline enum wire_node_state wire_word_state(uint64_t word)
{
	return (enum wire_node_state)(word & 3);
}

static inline uint32_t wire_word_page(uint64_t word)
{
	return (uint32_t)(word >> 2) & (WIRE_SEGMENT_PAGES_MAX - 1);
}

static inline uint32_t wire_word_segment(uint64_t word)
{
	return (uint32_t)(word >> 18) & (WIRE_SEGMENT_COUNT_MAX - 1);
}

static inline uint64_t wire_word_fill_count(uint64_t word)
{
	return word >> 30;
}

/**
 * One a session and store: bit n of words[n / 64] says that the session holds node n, which is READY.
 */
struct wire_grants {
	_Atomic uint64_t epoch; /* 0 before the holds of a session that is over are given back */
	uint64_t node_count;
	uint64_t reserved[6];
	_Atomic uint64_t words[];
};

static_assert(sizeof(struct wire_header) == 8, "no hidden padding");
static_assert(sizeof(struct wire_entry) == 12, "no hidden padding");
static_assert(sizeof(struct wire_refusal) == 12, "no hidden padding");
static_assert(sizeof(struct wire_hello) == 80, "no hidden padding");
static_assert(sizeof(struct wire_welcome) == 32, "no hidden padding");
static_assert(sizeof(struct wire_open) == 1040, "no hidden padding");
static_assert(sizeof(struct wire_opened) == 72, "no hidden padding");
static_assert(sizeof(struct wire_set) == 24, "no hidden padding");
static_assert(sizeof(struct wire_prefetch) == 16, "no hidden padding");
static_assert(sizeof(struct wire_segment) == 24, "no hidden padding");
static_assert(sizeof(struct wire_event) == 32, "no hidden padding");
static_assert(sizeof(struct wire_not_now) == 24, "no hidden padding");
static_assert(sizeof(struct wire_recall) == 16, "no hidden padding");
static_assert(sizeof(struct wire_text) == 16, "no hidden padding");
static_assert(sizeof(struct wire_status) == 24, "no hidden padding");
static_assert(sizeof(struct wire_admin) == 24, "no hidden padding");
static_assert(sizeof(struct wire_node) == 24, "no hidden padding");
static_assert(sizeof(struct wire_nodes) == 24, "no hidden padding");
static_assert(sizeof(struct wire_error) == 24 + WHY_TEXT_BYTES, "no hidden padding");
static_assert(sizeof(struct wire_directory) == 64, "words begin on a cache line");
static_assert(sizeof(struct wire_grants) == 64, "words begin on a cache line");

/** Entries that fit into one message of SET or PREFETCH. */
#define WIRE_SET_ENTRY_COUNT_MAX                                                                   \
	((WIRE_MESSAGE_BYTES_MAX - sizeof(struct wire_set)) / sizeof(struct wire_entry))
#define WIRE_REFUSAL_COUNT_MAX                                                                     \
	((WIRE_MESSAGE_BYTES_MAX - sizeof(struct wire_not_now)) / sizeof(struct wire_refusal))
/** Nodes that fit into one message of ADMIN. */
#define WIRE_ADMIN_NODE_COUNT_MAX                                                                  \
	((WIRE_MESSAGE_BYTES_MAX - sizeof(struct wire_admin)) / sizeof(uint32_t))
/** Nodes of one answer to WIRE_STATUS_NODES: half a message, as texts go in halves. */
#define WIRE_NODES_ENTRY_COUNT_MAX 1024u
#define WIRE_TEXT_BYTES_MAX        (WIRE_MESSAGE_BYTES_MAX - sizeof(struct wire_text))

/** Bounds of wire_opened.segment_bytes_log2: a word has 16 bits for a page. */
#define WIRE_SEGMENT_LOG2_MIN 12u
#define WIRE_SEGMENT_LOG2_MAX 28u

/** Who sends a message. */
enum wire_side {
	WIRE_FROM_CLIENT,
	WIRE_FROM_DAEMON
};

/**
 * Judges a received datagram: known type for that side, exact length, reserved fields zero, strings
 * terminated, flags known, store numbers in range, importances finite and descending, the right
 * number of descriptors.  A HELLO of another version passes when its head is whole, so that it can
 * be answered.
 *
 * message:  8-byte aligned.
 *
 * Returns: 0, -EPROTO, or -EMSGSIZE, with the reason.
 */
int wire_check(enum wire_side side, const void *message, size_t message_bytes, size_t fd_count,
	       struct why *why);

/** Fills a header. */
void wire_header_init(struct wire_header *header, enum wire_type type, size_t bytes);

/** "SET"; never NULL. */
const char *wire_type_name(uint16_t type);

/**
 * Sends one datagram with descriptors, without blocking and without SIGPIPE.
 *
 * Returns: 0, -EAGAIN, -EPIPE or another -errno.
 */
int wire_send(int socket_fd, const void *message, size_t message_bytes, const int *fds,
	      size_t fd_count);

/**
 * Receives one datagram, without blocking; descriptors are close-on-exec.
 *
 * message:   WIRE_MESSAGE_BYTES_MAX bytes, 8-byte aligned.
 * ret_fds:   WIRE_FD_COUNT_MAX; the caller's to close.
 *
 * Returns: its length, 0 when the peer has hung up, -EAGAIN, -EMSGSIZE (longer than a message),
 * -EPROTO (too many descriptors, or none free in this process) or another -errno.  On failure all
 * its descriptors are closed.
 */
int wire_receive(int socket_fd, void *message, int *ret_fds, size_t *ret_fd_count);

#define WIRE_SYSTEM_SOCKET "/run/oocd/oocd.sock"

/**
 * Where the daemon listens.  In this order: `given`, $OOCD_SOCKET, WIRE_SYSTEM_SOCKET where it
 * exists, wire_user_socket_path().
 *
 * given:  NULL: none.
 *
 * Returns: 0, or -ENAMETOOLONG when it does not fit into an address.
 */
int wire_socket_path(const char *given, char *ret_path, size_t path_bytes);

/** A user's own daemon: $XDG_RUNTIME_DIR/oocd.sock, else /tmp/oocd-UID/oocd.sock. */
int wire_user_socket_path(char *ret_path, size_t path_bytes);

#endif /* LIBCLIENT_WIRE_H */
