/* SPDX-License-Identifier: MIT */
/**
 * session.h - one client: what it says, and what it is owed.
 *
 *	from      to        when
 *	GREETING  READY     HELLO of our version
 *	GREETING  (gone)    anything else, or nothing for HELLO_SECONDS_MAX
 *	READY     (gone)    hang-up, death, a broken rule, owed messages unread for too long, or no
 *	                    answer to RECALL
 *
 * What a client is owed (refusals, an answer, an event) is not queued: it is found out when the
 * socket has room, so that a client that reads slowly gets fewer and newer messages, and one that
 * does not read costs nothing.
 *
 * Holds are leases.  A client that holds what others may have is asked to let go (RECALL) when
 * it does not say it anyway; a client that has said nothing for half its lease while more is wanted
 * than fits is asked as well.  Who gives nothing back and does not answer for a whole lease is
 * disconnected.  While there is room for all nobody is asked anything.
 *
 * Threads: loop thread.
 */
#ifndef DAEMON_SERVER_SESSION_H
#define DAEMON_SERVER_SESSION_H

#include <stdbool.h>
#include <stdint.h>

#include "daemon/server/connection.h"
#include "daemon/sharing/accounts.h"
#include "daemon/sharing/queues.h"
#include "daemon/sharing/visible.h"
#include "formats/base/list.h"
#include "libclient/wire.h"

struct session;

/** Control that goes up. */
struct session_calls {
	/**
	 * A client wants a store: answered by session_opened() or session_refuse(), now or later.
	 *
	 * fd:      the callee's.
	 * ticket:  of this OPEN.
	 */
	void (*open)(void *arg, struct session *session, uint32_t slot, uint32_t ticket, int fd,
		     const char *path);
	/**
	 * The answer to a STATUS or an ADMIN, as a text for free().
	 *
	 * Returns: 0, or -errno with the reason, which the client is told instead.
	 */
	int (*answer)(void *arg, struct session *session, const struct wire_header *question,
		      char **ret_text, struct why *why);
	/** Something is to be done at the end of the round. */
	void (*active)(void *arg);
	/** It is over, and to be destroyed. */
	void (*gone)(void *arg, struct session *session);
};

enum session_state {
	SESSION_GREETING, /* connected; it may say HELLO and nothing else */
	SESSION_READY,
};

struct session {
	struct list link; /* server.sessions */
	enum session_state state;
	uint32_t number;
	struct connection *connection;
	const struct session_calls *calls;
	void *calls_arg;
	struct account *account; /* of its user */
	struct room *room;
	struct queues *queues;
	uint64_t epoch;
	uint64_t born_ns;
	char name[WIRE_NAME_BYTES];

	struct memfile page_file;
	struct wire_session_page *page;
	struct visible visible;
	struct queue_entry queue_entry;
	uint32_t tickets[WIRE_STORE_COUNT_MAX]; /* of OPENs that are not answered; 0: none */
	uint32_t next_ticket;

	/* A set on its way, of several messages. */
	struct wire_entry *incoming;
	uint32_t incoming_count;
	uint32_t incoming_capacity;
	uint64_t incoming_serial; /* 0: none */

	struct wire_entry *prefetch; /* still queued, from prefetch_next on */
	uint32_t prefetch_count;
	uint32_t prefetch_next;
	uint64_t prefetch_bytes; /* left of what may be prefetched in this frame */
	uint32_t prefetch_left;  /* nodes of it */

	bool events; /* the set asks for them */
	/* What was told by the newest, and when the next one may be sent that tells no more of these. */
	uint64_t event_settled;
	uint64_t event_complete;
	uint64_t event_at_ns;
	/* The answer on its way, to `question`; 0: none is.  NODES is made when there is room for it. */
	uint16_t question;
	char *text; /* NULL: NODES */
	size_t text_bytes;
	size_t text_sent;
	uint32_t nodes_store;
	uint32_t nodes_first;
	uint64_t owed_since_ns; /* 0: nothing waits for room in the socket */

	uint64_t lease_ns;
	uint64_t heard_ns;      /* its last message */
	uint64_t recalled_ns;   /* asked to let go, and has not answered; 0: no */
	uint64_t recalled_gave; /* visible.given_up_count then */
	uint64_t asked_ns;      /* to let go, the last time */
	bool recall_owed;
};

struct session_config {
	const struct session_calls *calls;
	void *calls_arg;
	struct account *account; /* joined; left by the session's owner after session_destroy() */
	struct room *room;
	struct queues *queues;
	struct fills *fills;
	sd_event *event;
	uint32_t number;
	uint64_t epoch;
	uint64_t lease_ns; /* that a client has to answer RECALL */
};

/** socket_fd: taken over, whatever happens.  Returns: 0 or -errno. */
int session_create(const struct session_config *config, int socket_fd, struct session **ret,
		   struct why *why);
/** The daemon ends: what its client sees stays as it is, so that it can draw on. */
void session_freeze(struct session *session);
/** Gives everything back.  NULL is allowed.  Returns: NULL. */
struct session *session_destroy(struct session *session);

/** Answers an OPEN, if the client still wants it. */
void session_opened(struct session *session, uint32_t slot, uint32_t ticket, struct served *served);
void session_refuse(struct session *session, uint32_t slot, uint32_t ticket, int error,
		    const struct why *why);

/** A segment of a store has come, or is about to go. */
void session_tell_segment(struct session *session, const struct served *served,
			  const struct segment *segment);
void session_tell_segment_gone(struct session *session, const struct served *served,
			       uint32_t number);

/** See fills_ended_fn. */
void session_fill_ended(struct session *session, const struct fill_result *result);

/** Before a round's fetches are begun: tries again what was refused for room. */
void session_retry(struct session *session);
/**
 * After them: tells what is owed.
 *
 * event_pause_ns:  see EVENT_PAUSE_US.
 *
 * Returns: when it wants to be called again, whatever happens; UINT64_MAX: it does not.
 */
uint64_t session_tell(struct session *session, uint64_t now_ns, uint64_t event_pause_ns);

/**
 * Once a while: shows that the daemon lives, and how full the cache is; asks for what others need; drops
 * a client that does not greet, read or answer.
 *
 * used_bytes:  of the cache.
 */
void session_tick(struct session *session, uint64_t now_ns, uint64_t used_bytes);

#endif /* DAEMON_SERVER_SESSION_H */
