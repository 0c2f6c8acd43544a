/* SPDX-License-Identifier: MIT */
/**
 * fake_daemon.h - the daemon's side of the protocol, move by move, for tests of the client library.
 *
 * It answers nothing by itself: a test says what the daemon does next, and looks at what the client
 * has said.  What the client sends wrong aborts the test, from whatever thread.
 *
 * A fake store has `node_count` nodes.  Node 0 is the root and has nothing to draw; node n has
 * FAKE_PAYLOAD_BYTES, each of them (uint8_t)n in the segment where fake_ready() put it.
 */
#ifndef TESTS_UNIT_FAKE_DAEMON_H
#define TESTS_UNIT_FAKE_DAEMON_H

#include "libclient/ooc/client.h"
#include "libclient/wire.h"

#define FAKE_STORE_COUNT   4u
#define FAKE_SEGMENT_COUNT 4u
#define FAKE_SEGMENT_BYTES (1u << 20)
#define FAKE_PAYLOAD_BYTES 100u
#define FAKE_NODE_COUNT    20000u

#define FAKE_CHECK(condition) ((condition) ? (void)0 : fake_failed(#condition, __FILE__, __LINE__))
_Noreturn void fake_failed(const char *condition, const char *file, int line);

/** A memory file as the daemon shares them. */
struct fake_memory {
	int fd;
	uint64_t bytes;
	void *base; /* writable */
};

struct fake_store {
	struct fake_memory hs;
	struct fake_memory directory;
	struct fake_memory grants;
	struct fake_memory segments[FAKE_SEGMENT_COUNT];
	bool is_open;
};

struct fake_daemon {
	char path[100];       /* of the socket */
	char store_path[100]; /* a file that can be opened */
	int listen_fd;
	int fd; /* of the one client; -1: none */
	uint64_t epoch;
	uint64_t generation; /* that OPENED will speak of */
	unsigned seals;      /* of memory made from now on */
	struct fake_memory page;
	struct fake_store stores[FAKE_STORE_COUNT];
	_Alignas(8) uint8_t message[WIRE_MESSAGE_BYTES_MAX];
	int passed_fd; /* that came with the last message; -1: none */
};

struct fake_daemon *fake_create(const char *folder);
void fake_destroy(struct fake_daemon *fake);

/** Takes a connection and its HELLO. */
void fake_accept(struct fake_daemon *fake);
/** Answers it. */
void fake_welcome(struct fake_daemon *fake);
/** Takes an OPEN and answers it, with segment 0 announced. */
void fake_serve_open(struct fake_daemon *fake);
/** Drops the client and its stores, as a daemon that dies does. */
void fake_die(struct fake_daemon *fake);

/** ooc_connect() and ooc_open() with the fake's moves in another thread. */
struct ooc_client *fake_connect(struct fake_daemon *fake);
struct ooc_store *fake_open(struct fake_daemon *fake, struct ooc_client *client);

/** The next message, which must be of this type; waits for it. */
const void *fake_expect(struct fake_daemon *fake, enum wire_type type);
/** No message is there. */
void fake_expect_nothing(struct fake_daemon *fake);
/** A SET in one message; checks its serial where it is not 0. */
const struct wire_set *fake_expect_set(struct fake_daemon *fake, uint64_t serial);

void fake_send(struct fake_daemon *fake, void *message, enum wire_type type, size_t bytes,
	       const int *fds, size_t fd_count);
void fake_segment(struct fake_daemon *fake, uint32_t store, uint32_t segment);
void fake_segment_gone(struct fake_daemon *fake, uint32_t store, uint32_t segment);
void fake_event(struct fake_daemon *fake, uint64_t serial, bool settled);
void fake_refuse(struct fake_daemon *fake, uint64_t serial, uint32_t store, uint32_t node,
		 uint32_t reason);

void fake_acknowledge(struct fake_daemon *fake, uint64_t serial);
void fake_settle(struct fake_daemon *fake, uint64_t serial);
void fake_grant(struct fake_daemon *fake, uint32_t store, uint32_t node, bool granted);
/** Fills the payload's bytes, then says where they are. */
void fake_ready(struct fake_daemon *fake, uint32_t store, uint32_t node, uint32_t segment,
		uint32_t page);
void fake_word(struct fake_daemon *fake, uint32_t store, uint32_t node, uint64_t word);

/** Memory of `bytes` zero bytes, sealed as fake->seals says. */
struct fake_memory fake_memory_make(const struct fake_daemon *fake, uint64_t bytes);
void fake_memory_free(struct fake_memory *memory);

/* ---- a client with one store open, and its daemon ---- */

struct fake_scene {
	char *folder;
	struct fake_daemon *fake;
	struct ooc_client *client;
	struct ooc_store *store;
};

/** For cmocka_unit_test_setup_teardown(): *state is a struct fake_scene. */
int fake_scene_setup(void **state);
int fake_scene_teardown(void **state);

/** The client gives the set of nodes first .. first + count - 1.  Returns: as ooc_visible_set(). */
int64_t fake_give(const struct fake_scene *scene, uint32_t first, uint32_t count);

#endif /* TESTS_UNIT_FAKE_DAEMON_H */
