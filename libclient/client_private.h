/* SPDX-License-Identifier: MIT */
/**
 * client_private.h - what the files of the client library know of each other.
 *
 *	client.c          the public functions that wait, and those that look at the whole client
 *	client_session.c  the socket: connecting, greeting, messages taken and sent, loss
 *	client_store.c    opening and closing stores
 *	client_view.c     a store's shared memory: what is drawable, and where it is
 *	client_question.c questions and orders to the daemon, and their answers
 *	client_set.c      sets: what is wanted, what was said, what is no longer drawn
 *
 * Life of a session; the client outlives any number of them:
 *
 *	         connected, HELLO sent           WELCOME
 *	  AWAY -------------------------> GREETING ---------> LIVE
 *	   ^                                 | hang-up, error,  |
 *	   |                                 | silence          | hang-up, protocol broken
 *	   +---------------------------------+------------------+
 *
 * Threads: as the public header says.
 */
#ifndef LIBCLIENT_CLIENT_PRIVATE_H
#define LIBCLIENT_CLIENT_PRIVATE_H

#include <sys/un.h>

#include "formats/base/bytes.h"
#include "libclient/mapping.h"
#include "libclient/ooc/client.h"
#include "libclient/starter.h"
#include "libclient/wire.h"

#define SOCKET_PATH_BYTES sizeof(((struct sockaddr_un *)NULL)->sun_path)

/** How long the daemon may take to greet, and to open a store, whose whole HS it may have to read. */
#define GREETING_TIMEOUT_NS (5 * NS_PER_S)
#define OPEN_TIMEOUT_NS     (60 * NS_PER_S)
#define ANSWER_TIMEOUT_NS   (10 * NS_PER_S)
/** Waits between attempts to reconnect, doubled from the first to the second. */
#define RETRY_WAIT_MIN_NS (10 * NS_PER_MS)
#define RETRY_WAIT_MAX_NS NS_PER_S
/** Longer texts are not believed. */
#define ANSWER_BYTES_MAX (16 * MIB)
/**
 * A daemon that died has said nothing.  Where a program draws frame after frame its socket is looked at
 * once the daemon has shown no sign of life for the first, and then every second of these times.  (Who
 * sleeps on it is woken.)
 */
#define SILENCE_NS (2 * WIRE_BEAT_MS * NS_PER_MS)
#define LOOK_NS    (100 * NS_PER_MS)
/** Views of lost sessions that a store keeps mapped for threads that may still draw from them. */
#define OLD_VIEW_COUNT_MAX 4u
/** Sets sent that ooc_retire() can tell apart. */
#define SENT_COUNT_MAX 64u

enum session_state {
	SESSION_AWAY,     /* no socket */
	SESSION_GREETING, /* HELLO is sent, WELCOME to come */
	SESSION_LIVE,
};

/** What is known of one node's place in the sets.  Serials count sets; 0 is none. */
struct want {
	uint64_t given;   /* newest set given that has it */
	uint64_t sent;    /* newest set sent that has it */
	uint64_t since;   /* the set sent since which all have had it */
	uint64_t refused; /* newest set in which it was answered "not now" << 3 | enum ooc_reason */
	/* Of its HS record, once it was in a set: a frame looks at no other memory of the node. */
	uint32_t payload_bytes;
};

/** Mapped memory that holds payloads. */
struct segment_slot {
	struct mapping mapping;
	uint64_t unique;
};

/**
 * What one session has been shown of a store.
 *
 * The newest session's is the store's `view`.  Those of lost sessions go on the list of old views:
 * what was drawable when the session was lost stays so until the newest set is settled again.
 */
struct view {
	struct view *next;
	uint64_t number; /* 1, 2 ... of the store */
	uint64_t epoch;
	struct mapping directory;
	struct mapping grants;
	uint64_t *words;      /* old: the word of each node that was drawable; NULL: none was */
	uint64_t last_serial; /* old: newest set given when it ceased to be shown; 0: it is shown */
	uint16_t slots[WIRE_SEGMENT_COUNT_MAX]; /* of each segment: its slot + 1; 0: not mapped */
};

enum store_state {
	STORE_UNASKED, /* to be opened in this session */
	STORE_ASKED,   /* OPEN is sent */
	STORE_OPEN,    /* view is there */
	STORE_LOST,    /* the daemon would not open it again: error says why */
};

struct ooc_store {
	struct ooc_client *client;
	uint32_t number; /* on the wire */
	enum store_state state;
	int error; /* STORE_LOST */
	int fd;
	char path[WIRE_PATH_BYTES];
	struct mapping hs;
	const struct store_superblock *superblock;
	const struct store_node *nodes;
	uint64_t node_count;
	struct want *wants;
	struct view *view;
	struct view *old_views;
	uint64_t view_count;
	struct segment_slot segments[WIRE_SEGMENT_COUNT_MAX];
};

/** The newest set given, and how much of it has been said. */
struct set {
	struct ooc_want *wants; /* as they were given, to know them again */
	size_t want_count;
	size_t want_capacity; /* of entries as well */
	bool is_whole;        /* no store of its wants was closed since */
	struct wire_entry *entries;
	size_t entry_count;
	uint64_t given;        /* its serial; 0: none was given yet */
	bool unsaid;           /* not sent to its end in this session */
	bool said_with_events; /* the daemon tells of the newest set sent */
	bool recalled; /* the next one given is a new one, so that what is drawn now can be retired */
	bool answer_owed;    /* to a RECALL */
	uint64_t sent;       /* newest set sent in this session, else one that no node has */
	uint64_t unanswered; /* sent, and not seen acknowledged; 0: none */
	uint64_t saying;   /* serial of a set of which only the first messages are sent; 0: none */
	size_t said_count; /* entries in them */
	uint64_t retired;  /* sets before it are not drawn, says the caller */
	uint64_t retire_unsent; /* RETIRE that did not fit into the socket; 0: none */
	uint64_t retire_sent;
	uint64_t sent_serials[SENT_COUNT_MAX]; /* of this session, the newest at sent_count - 1 */
	uint64_t sent_count;
};

/** The answer to a STATUS or an ADMIN, as it comes in. */
struct answer {
	bool wanted;
	bool done;
	int error;
	char *text;
	size_t text_bytes;
	struct ooc_node_info *nodes; /* where those of NODES go; NULL: a text is the answer */
	uint32_t node_count;
	unsigned abandoned_count; /* answers that nobody waits for any more */
};

struct ooc_client {
	char name[WIRE_NAME_BYTES];
	/* Where to look for the daemon, in order. */
	char socket_paths[2][SOCKET_PATH_BYTES];
	size_t socket_path_count;
	bool may_start;  /* a daemon, at the last of them */
	bool own_folder; /* the last of them lies where anyone could have made it */
	struct starter starter;
	char *daemon_options[STARTER_OPTION_COUNT_MAX + 1]; /* for a daemon that is started */
	struct why why;

	enum session_state state;
	int socket_fd;
	bool blocked; /* something waits for room in the socket */
	bool was_live;
	uint64_t greeting_deadline_ns;
	uint64_t retry_at_ns;
	uint64_t retry_wait_ns;
	struct mapping page;
	uint64_t epoch;
	uint64_t taken_count; /* messages of this session */
	uint64_t beat;        /* as the daemon's was seen last */
	uint64_t look_at_ns;  /* then the socket is looked at although no message is known of */

	struct ooc_store *stores[WIRE_STORE_COUNT_MAX];
	/* Bits of numbers that may not be used again yet. */
	uint64_t unanswered_opens; /* given up; the answer is still to come */
	uint64_t unsent_closes;
	bool a_store_was_lost; /* ooc_dispatch() has not told yet */

	struct set set;
	uint64_t serial; /* newest given to anything */
	bool keep_drawing;
	bool notify;
	bool waiting; /* inside ooc_wait() */
	uint64_t segment_unique;
	struct answer answer;
	struct ooc_counters counters;

	_Alignas(8) uint8_t incoming[WIRE_MESSAGE_BYTES_MAX];
	_Alignas(8) uint8_t outgoing[WIRE_MESSAGE_BYTES_MAX];
};

/* ---- client_session.c ---- */

/**
 * One attempt to connect; notes when the next one may be.
 *
 * Returns: 0, -EAGAIN (a daemon is starting) or -errno.
 */
int session_connect(struct ooc_client *client);

/** Ends the session, if there is one.  `why` of the client says the reason. */
void session_lose(struct ooc_client *client);

/**
 * Takes all messages that are there and sends what has waited for room.
 *
 * Returns: 0, or the error that has ended the session.
 */
int session_run(struct ooc_client *client);

/** Sends one message.  Returns: 0, -EAGAIN, or -ENOTCONN when that was the end of the session. */
int session_send(struct ooc_client *client, const void *message, size_t message_bytes,
		 const int *fds, size_t fd_count);

/** Waits until something comes in, room comes up, or it is time to reconnect. */
void session_pause(struct ooc_client *client, uint64_t deadline_ns);

static inline const struct wire_session_page *session_page(const struct ooc_client *client)
{
	return client->page.base;
}

/* ---- client_store.c ---- */

struct ooc_store *store_destroy(struct ooc_store *store);

/** Sends OPEN.  Returns as session_send(). */
int store_ask(struct ooc_store *store);

/** Takes the answer in.  Returns: 0, or -EPROTO or -ENOMEM, which ends the session. */
int store_take_opened(struct ooc_client *client, const struct wire_opened *opened, const int *fds);
void store_take_error(struct ooc_client *client, const struct wire_error *error);

/** Says CLOSE for stores that are closed and could not say it then. */
void store_flush_closes(struct ooc_client *client);

/* ---- client_view.c ---- */

/** Returns: 0, -EPROTO or -ENOMEM.  Ownership: ends with view_destroy(). */
int view_create(struct ooc_store *store, const struct wire_opened *opened, int directory_fd,
		int grants_fd, struct view **ret);
struct view *view_destroy(struct ooc_store *store, struct view *view);

/**
 * Before another session: lets go of the oldest view where there are too many.
 *
 * Returns: false while threads may still draw from it.
 */
bool view_make_room(struct ooc_store *store);

/** The session is over: what is drawable in the store's view stays so in an old view. */
void view_grow_old(struct ooc_store *store);

/** The newest set is settled in the new session: old views are shown no longer, and let go. */
void view_forget_old(struct ooc_store *store);

/** Lets go of old views that nobody can draw from any more. */
void view_release_old(struct ooc_store *store);

int view_take_segment(struct ooc_store *store, const struct wire_segment *message, int fd);
void view_take_segment_gone(struct ooc_store *store, uint32_t segment);

/* ---- client_question.c ---- */

/** The session is over. */
void answer_lose(struct ooc_client *client);

/** Take an answer in.  Returns: 0, or -EPROTO or -ENOMEM, which ends the session. */
int answer_take_text(struct ooc_client *client, const struct wire_text *message);
int answer_take_nodes(struct ooc_client *client, const struct wire_nodes *message);
void answer_take_error(struct ooc_client *client, const struct wire_error *error);

/* ---- client_set.c ---- */

/** A new session: nothing has been said in it. */
void set_restart(struct ooc_client *client);

/** Says what is unsaid, where it may and can be. */
void set_flush(struct ooc_client *client);

/** Is the daemon asked to wake this program when something has changed? */
bool set_wants_events(const struct ooc_client *client);

/** Takes a closed store's nodes out. */
void set_drop_store(struct ooc_client *client, const struct ooc_store *store);

/** The daemon needs room: it is answered, which gives back what may not be kept. */
void set_take_recall(struct ooc_client *client);

void set_take_not_now(struct ooc_client *client, const struct wire_not_now *message);

#endif /* LIBCLIENT_CLIENT_PRIVATE_H */
