/* SPDX-License-Identifier: MIT */
/**
 * daemon_kit.h - a daemon in a process of its own, and clients that speak the bytes of wire.h.
 *
 * The clients are not the library's, so that the daemon is tested against the protocol, and with
 * messages that the library would never send.  What goes wrong fails the test.
 *
 * Include it after <cmocka.h>.
 */
#ifndef TESTS_INTEGRATION_DAEMON_KIT_H
#define TESTS_INTEGRATION_DAEMON_KIT_H

#include <stdbool.h>
#include <stdint.h>
#include <sys/types.h>

#include "daemon/server/server.h"
#include "formats/store/layout.h"
#include "libclient/wire.h"

#define KIT_STORES_MAX   4u
#define KIT_TIMEOUT_MS   20000
#define KIT_MESSAGE_ROOM WIRE_MESSAGE_BYTES_MAX

/* ---- the daemon ---- */

struct kit_daemon {
	pid_t pid;
	char socket_path[108];
};

/** What a test has no wish for: 64 MiB, io_uring where there is, one worker. */
struct server_config kit_config(void);

/** Starts a daemon on folder/oocd.sock and waits until it listens. */
void kit_daemon_start(const char *folder, const struct server_config *config,
		      struct kit_daemon *ret);

/** The same, after prepare() has taken something away in the daemon's process. */
void kit_daemon_start_prepared(const char *folder, const struct server_config *config,
			       void (*prepare)(void), struct kit_daemon *ret);

/** Ends it by a signal and waits.  Returns: its exit status, or minus the signal that killed it. */
int kit_daemon_stop(struct kit_daemon *daemon, int signal);

/** Lets other users come to the daemon. */
void kit_let_others_in(const char *folder, const struct kit_daemon *daemon);

/** Descriptors that a process has open. */
uint32_t kit_descriptor_count(pid_t pid);

/* ---- a client ---- */

struct kit_store {
	const struct store_superblock *superblock; /* NULL: not open */
	const struct store_node *nodes;
	uint32_t node_count;
	const struct wire_directory *directory;
	const struct wire_grants *grants;
	struct wire_opened opened;
	uint64_t segment_bytes;
	const uint8_t *segments[WIRE_SEGMENT_COUNT_MAX]; /* NULL: none */
};

struct kit_client {
	int fd;
	uint64_t serial;
	uint64_t epoch;
	const struct wire_session_page *page;
	struct kit_store stores[KIT_STORES_MAX];
	/* Of the set `serial`. */
	uint32_t refusal_count;
	enum wire_reason last_reason;
	uint32_t event_count;
	bool recalled; /* asked to let go, and has said no set since */
	_Alignas(8) uint8_t message[KIT_MESSAGE_ROOM];
};

/** Connects without a word. */
struct kit_client *kit_connect(const struct kit_daemon *daemon);
/** And says HELLO. */
struct kit_client *kit_hello(const struct kit_daemon *daemon);
void kit_disconnect(struct kit_client *client);

/** Sends bytes as they are; whether they arrive is for the test to see. */
void kit_send(struct kit_client *client, const void *message, size_t bytes, int fd);

/**
 * Receives until a message of that type has come, or the daemon hangs up (type 0); takes segments,
 * refusals and events in passing.
 *
 * Returns: the message, in client->message.
 */
const void *kit_receive(struct kit_client *client, uint16_t type);

/** Receives one message, of whatever type, with the same care. */
void kit_receive_any(struct kit_client *client);

/** Sends OPEN.  fd: closed by the caller. */
void kit_send_open(struct kit_client *client, uint32_t slot, int fd);
/** Opens a store. */
struct kit_store *kit_open(struct kit_client *client, uint32_t slot, const char *path);
/** Receives the ERROR to an OPEN that must fail.  Returns: its errno, negative. */
int kit_open_error(struct kit_client *client, uint32_t slot, int fd);

/** Sends a set of entries.  flags: besides FIRST, LAST and EVENTS. */
void kit_set(struct kit_client *client, const struct wire_entry *entries, uint32_t count,
	     uint32_t flags);
/** Nodes with payload first .. first + count - 1 of a store, as entries. */
uint32_t kit_entries(const struct kit_store *store, uint32_t slot, uint32_t first, uint32_t count,
		     struct wire_entry *ret);
/** As many as there are. */
#define KIT_ALL UINT32_MAX
/** Sends a set of these nodes of an open store.  Returns: how many they are. */
uint32_t kit_want(struct kit_client *client, uint32_t slot, uint32_t first, uint32_t count,
		  uint32_t flags);
/** Sends a PREFETCH of these nodes.  Returns: likewise. */
uint32_t kit_prefetch(struct kit_client *client, uint32_t slot, uint32_t first, uint32_t count);
/** Returns: is it settled? */
bool kit_is_settled(const struct kit_client *client);
/** Waits until the set is settled. */
void kit_settle(struct kit_client *client);

/** The rule of drawing: acknowledged (the caller's business), granted, READY, its segment known. */
const uint8_t *kit_map(const struct kit_store *store, uint32_t node);
/** What a client would draw that trusts READY and asks for no grant. */
const uint8_t *kit_map_ungranted(const struct kit_store *store, uint32_t node);
/** Checks a mapped payload whole.  Returns: is it the node's? */
bool kit_is_whole(const struct kit_store *store, uint32_t node);
/** Nodes with payload that are drawable and whole; one that is drawable and not whole fails. */
uint32_t kit_count_drawable(const struct kit_store *store);
uint32_t kit_count_payloads(const struct kit_store *store);

/** Is a client served?  It gets twenty nodes of the store in slot 0, and nothing else. */
void kit_check_served(struct kit_client *client, uint32_t first);

/** Asks for the status.  Ownership: free(). */
char *kit_status(struct kit_client *client);
/** The first number after "key": in the status. */
uint64_t kit_status_number(struct kit_client *client, const char *key);
/** Asks until the number is what it should become. */
void kit_await_number(struct kit_client *client, const char *key, uint64_t value);

#endif /* TESTS_INTEGRATION_DAEMON_KIT_H */
