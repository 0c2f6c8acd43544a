/* SPDX-License-Identifier: MIT */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include "formats/base/bytes.h"
#include "formats/base/log.h"
#include "formats/store/payload.h"
#include "formats/store/store_checksum.h"
#include "tests/helper.h"
#include "tests/integration/daemon_kit.h"

/* ---- the daemon ---- */

struct server_config kit_config(void)
{
	return (struct server_config){
		.socket_fd = -1,
		.cache_bytes = 64 * MIB,
		.queue_depth = 16,
		.worker_count = 1,
		.fetch_kind = FETCH_AUTO,
		.idle_close_s = 300,
	};
}

static _Noreturn void daemon_main(const struct server_config *config, int ready_fd)
{
	struct server *server;
	struct why why;
	int r;

	/* What it says of damaged stores is not what is looked at here. */
	log_init("oocd", LOG_LEVEL_ERROR - 1);
	r = server_create(config, &server, &why);
	if (r < 0) {
		(void)fprintf(stderr, "oocd: %s\n", why.text);
		exit(1);
	}
	(void)!write(ready_fd, "r", 1);
	(void)close(ready_fd);
	r = server_run(server);
	server_destroy(server);
	exit(r < 0 ? 1 : 0);
}

void kit_daemon_start(const char *folder, const struct server_config *config,
		      struct kit_daemon *ret)
{
	kit_daemon_start_prepared(folder, config, NULL, ret);
}

void kit_daemon_start_prepared(const char *folder, const struct server_config *config,
			       void (*prepare)(void), struct kit_daemon *ret)
{
	struct server_config own = *config;
	int ready[2];
	char byte;

	(void)snprintf(ret->socket_path, sizeof(ret->socket_path), "%s/oocd.sock", folder);
	own.socket_path = ret->socket_path;
	assert_int_equal(pipe2(ready, O_CLOEXEC), 0);
	ret->pid = test_fork();
	if (ret->pid == 0) {
		(void)close(ready[0]);
		if (prepare)
			prepare();
		daemon_main(&own, ready[1]);
	}
	(void)close(ready[1]);
	if (read(ready[0], &byte, 1) != 1)
		fail_msg("the daemon does not start");
	(void)close(ready[0]);
}

int kit_daemon_stop(struct kit_daemon *daemon, int signal)
{
	assert_int_equal(kill(daemon->pid, signal), 0);
	return test_wait(daemon->pid);
}

void kit_let_others_in(const char *folder, const struct kit_daemon *daemon)
{
	assert_int_equal(chmod(folder, 0711), 0);
	assert_int_equal(chmod(daemon->socket_path, 0666), 0);
}

uint32_t kit_descriptor_count(pid_t pid)
{
	char path[64];
	uint32_t count = 0;
	DIR *folder;

	(void)snprintf(path, sizeof(path), "/proc/%d/fd", (int)pid);
	folder = opendir(path);
	assert_non_null(folder);
	while (readdir(folder))
		count++;
	(void)closedir(folder);
	/* "." and ".." */
	return count - 2;
}

/* ---- a client ---- */

struct kit_client *kit_connect(const struct kit_daemon *daemon)
{
	struct sockaddr_un address = { .sun_family = AF_UNIX };
	struct kit_client *client = calloc(1, sizeof(*client));

	(void)snprintf(address.sun_path, sizeof(address.sun_path), "%s", daemon->socket_path);
	client->fd = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0);
	assert_true(client->fd >= 0);
	if (connect(client->fd, (struct sockaddr *)&address, sizeof(address)) < 0)
		fail_msg("connect: %s", strerror(errno));
	return client;
}

static const void *map_shared(int fd, uint64_t bytes)
{
	const void *map = mmap(NULL, bytes, PROT_READ, MAP_SHARED, fd, 0);

	assert_ptr_not_equal(map, MAP_FAILED);
	(void)close(fd);
	return map;
}

static void unmap(const void *map, uint64_t bytes)
{
	if (map)
		(void)munmap((void *)(uintptr_t)map, bytes);
}

void kit_send(struct kit_client *client, const void *message, size_t bytes, int fd)
{
	int r;

	do
		r = wire_send(client->fd, message, bytes, &fd, fd >= 0 ? 1 : 0);
	while (r == -EAGAIN && poll(&(struct pollfd){ client->fd, POLLOUT, 0 }, 1, 1000) >= 0);
}

static void take_segment(struct kit_client *client, const struct wire_segment *message, int fd)
{
	struct kit_store *store = &client->stores[message->store];

	assert_null(store->segments[message->segment]);
	store->segment_bytes = message->segment_bytes;
	store->segments[message->segment] = map_shared(fd, message->segment_bytes);
}

static void take_segment_gone(struct kit_client *client, const struct wire_segment_gone *message)
{
	struct kit_store *store = &client->stores[message->store];

	assert_non_null(store->segments[message->segment]);
	unmap(store->segments[message->segment], store->segment_bytes);
	store->segments[message->segment] = NULL;
}

static void take_opened(struct kit_client *client, const struct wire_opened *message,
			const int *fds)
{
	struct kit_store *store = &client->stores[message->store];

	store->opened = *message;
	store->superblock = map_shared(fds[0], message->hs_bytes);
	store->nodes = (const struct store_node *)(const void *)(store->superblock + 1);
	store->directory = map_shared(fds[1], message->directory_bytes);
	store->grants = map_shared(fds[2], message->grants_bytes);
	store->node_count = (uint32_t)message->node_count;
	assert_int_equal(store->directory->node_count, message->node_count);
	assert_true(store->directory->epoch == client->epoch);
	assert_true(store->grants->epoch == client->epoch);
}

static void take_message(struct kit_client *client, const int *fds)
{
	const struct wire_not_now *not_now = (const void *)client->message;

	switch (((const struct wire_header *)(const void *)client->message)->type) {
	case WIRE_OPENED:
		take_opened(client, (const void *)client->message, fds);
		break;
	case WIRE_WELCOME:
		client->epoch = ((const struct wire_welcome *)(const void *)client->message)->epoch;
		client->page = map_shared(fds[0], sizeof(*client->page));
		break;
	case WIRE_SEGMENT:
		take_segment(client, (const void *)client->message, fds[0]);
		break;
	case WIRE_SEGMENT_GONE:
		take_segment_gone(client, (const void *)client->message);
		break;
	case WIRE_NOT_NOW:
		if (not_now->serial != client->serial)
			break;
		client->refusal_count += not_now->entry_count;
		client->last_reason = not_now->entries[0].reason;
		break;
	case WIRE_EVENT:
		client->event_count++;
		break;
	case WIRE_RECALL:
		client->recalled = true;
		break;
	default:
		break;
	}
}

/* Returns: its type, 0 when the daemon has hung up, or -ETIMEDOUT. */
static int receive_one(struct kit_client *client, int timeout_ms)
{
	struct pollfd poll_fd = { client->fd, POLLIN, 0 };
	int fds[WIRE_FD_COUNT_MAX];
	size_t fd_count = 0;
	struct why why;
	int r;

	if (poll(&poll_fd, 1, timeout_ms) != 1)
		return -ETIMEDOUT;
	r = wire_receive(client->fd, client->message, fds, &fd_count);
	if (r == 0 || r == -ECONNRESET)
		return 0;
	assert_true(r > 0);
	if (wire_check(WIRE_FROM_DAEMON, client->message, (size_t)r, fd_count, &why) < 0)
		fail_msg("the daemon says what it may not: %s", why.text);
	take_message(client, fds);
	return ((const struct wire_header *)(const void *)client->message)->type;
}

const void *kit_receive(struct kit_client *client, uint16_t type)
{
	int r;

	do
		r = receive_one(client, KIT_TIMEOUT_MS);
	while (r > 0 && r != type);
	if (r != type)
		fail_msg("no %s: %s", type ? wire_type_name(type) : "hang-up",
			 r == 0 ? "the daemon hung up" : "nothing came");
	return client->message;
}

void kit_receive_any(struct kit_client *client)
{
	if (receive_one(client, KIT_TIMEOUT_MS) <= 0)
		fail_msg("the daemon is away");
}

struct kit_client *kit_hello(const struct kit_daemon *daemon)
{
	struct kit_client *client = kit_connect(daemon);
	struct wire_hello hello = { .version = WIRE_VERSION, .name = "kit" };

	wire_header_init(&hello.header, WIRE_HELLO, sizeof(hello));
	kit_send(client, &hello, sizeof(hello), -1);
	kit_receive(client, WIRE_WELCOME);
	return client;
}

void kit_disconnect(struct kit_client *client)
{
	(void)close(client->fd);
	unmap(client->page, sizeof(*client->page));
	for (uint32_t s = 0; s < KIT_STORES_MAX; s++) {
		struct kit_store *store = &client->stores[s];

		unmap(store->superblock, store->opened.hs_bytes);
		unmap(store->directory, store->opened.directory_bytes);
		unmap(store->grants, store->opened.grants_bytes);
		for (uint32_t i = 0; i < WIRE_SEGMENT_COUNT_MAX; i++)
			unmap(store->segments[i], store->segment_bytes);
	}
	free(client);
}

void kit_send_open(struct kit_client *client, uint32_t slot, int fd)
{
	struct wire_open open_message = { .store = slot, .path = "a test's store" };

	wire_header_init(&open_message.header, WIRE_OPEN, sizeof(open_message));
	kit_send(client, &open_message, sizeof(open_message), fd);
}

struct kit_store *kit_open(struct kit_client *client, uint32_t slot, const char *path)
{
	int fd = open(path, O_RDONLY | O_CLOEXEC);

	assert_true(fd >= 0);
	kit_send_open(client, slot, fd);
	(void)close(fd);
	kit_receive(client, WIRE_OPENED);
	return &client->stores[slot];
}

int kit_open_error(struct kit_client *client, uint32_t slot, int fd)
{
	const struct wire_error *error;

	kit_send_open(client, slot, fd);
	error = kit_receive(client, WIRE_ERROR);
	assert_int_equal(error->type, WIRE_OPEN);
	assert_int_equal(error->store, slot);
	assert_true(error->text[0] != '\0');
	return error->error;
}

void kit_set(struct kit_client *client, const struct wire_entry *entries, uint32_t count,
	     uint32_t flags)
{
	_Alignas(8) uint8_t bytes[WIRE_MESSAGE_BYTES_MAX];
	struct wire_set *message = (struct wire_set *)(void *)bytes;
	uint32_t sent = 0;

	client->serial++;
	client->refusal_count = 0;
	client->recalled = false;
	do {
		uint32_t piece = (uint32_t)u64_min(count - sent, WIRE_SET_ENTRY_COUNT_MAX);

		message->serial = client->serial;
		message->flags = flags | WIRE_SET_EVENTS | (sent == 0 ? WIRE_SET_FIRST : 0) |
				 (sent + piece == count ? WIRE_SET_LAST : 0);
		message->entry_count = piece;
		if (piece > 0)
			memcpy(message->entries, entries + sent, piece * sizeof(*entries));
		wire_header_init(&message->header, WIRE_SET,
				 sizeof(*message) + piece * sizeof(*entries));
		kit_send(client, message, message->header.bytes, -1);
		sent += piece;
	} while (sent < count);
}

uint32_t kit_entries(const struct kit_store *store, uint32_t slot, uint32_t first, uint32_t count,
		     struct wire_entry *ret)
{
	uint32_t ordinal = 0;
	uint32_t taken = 0;

	for (uint32_t i = 0; i < store->node_count && taken < count; i++) {
		if (store->nodes[i].payload_id == 0 || ordinal++ < first)
			continue;
		ret[taken] = (struct wire_entry){ slot, i, (float)(count - taken) };
		taken++;
	}
	return taken;
}

uint32_t kit_want(struct kit_client *client, uint32_t slot, uint32_t first, uint32_t count,
		  uint32_t flags)
{
	const struct kit_store *store = &client->stores[slot];
	struct wire_entry *entries = calloc(store->node_count, sizeof(*entries));

	count = kit_entries(store, slot, first, (uint32_t)u64_min(count, store->node_count),
			    entries);
	kit_set(client, entries, count, flags);
	free(entries);
	return count;
}

uint32_t kit_prefetch(struct kit_client *client, uint32_t slot, uint32_t first, uint32_t count)
{
	_Alignas(8) uint8_t bytes[WIRE_MESSAGE_BYTES_MAX] = { 0 };
	struct wire_prefetch *message = (struct wire_prefetch *)(void *)bytes;

	assert_true(sizeof(*message) + count * sizeof(message->entries[0]) <= sizeof(bytes));
	count = kit_entries(&client->stores[slot], slot, first, count, message->entries);
	message->entry_count = count;
	wire_header_init(&message->header, WIRE_PREFETCH,
			 sizeof(*message) + count * sizeof(message->entries[0]));
	kit_send(client, message, message->header.bytes, -1);
	return count;
}

bool kit_is_settled(const struct kit_client *client)
{
	return atomic_load_explicit(&client->page->settled, memory_order_acquire) >= client->serial;
}

void kit_settle(struct kit_client *client)
{
	while (!kit_is_settled(client))
		kit_receive(client, WIRE_EVENT);
	/* What was sent before is there, and says which segments and refusals there are. */
	while (receive_one(client, 0) > 0)
		continue;
}

const uint8_t *kit_map_ungranted(const struct kit_store *store, uint32_t node)
{
	uint64_t word = atomic_load_explicit(&store->directory->words[node], memory_order_acquire);
	const uint8_t *segment;

	if (wire_word_state(word) != WIRE_NODE_READY)
		return NULL;
	segment = store->segments[wire_word_segment(word)];
	return segment ? segment + (size_t)wire_word_page(word) * WIRE_PAGE_BYTES : NULL;
}

const uint8_t *kit_map(const struct kit_store *store, uint32_t node)
{
	uint64_t grants =
		atomic_load_explicit(&store->grants->words[node / 64], memory_order_acquire);

	return grants >> (node % 64) & 1 ? kit_map_ungranted(store, node) : NULL;
}

bool kit_is_whole(const struct kit_store *store, uint32_t node)
{
	const struct store_node *record = &store->nodes[node];
	const uint8_t *payload = kit_map(store, node);

	/* A coded one was judged by the daemon as it lies in the file; here as it is drawn. */
	if (record->codec == STORE_CODEC_NONE &&
	    store_checksum(payload, record->stored_bytes, record->payload_id) !=
		    record->payload_checksum)
		return false;
	return payload_validate(payload, record->payload_bytes, record, NULL) == 0;
}

uint32_t kit_count_drawable(const struct kit_store *store)
{
	uint32_t count = 0;

	for (uint32_t i = 0; i < store->node_count; i++) {
		if (store->nodes[i].payload_id == 0 || !kit_map(store, i))
			continue;
		if (!kit_is_whole(store, i))
			fail_msg("node %u is drawable and wrong", i);
		count++;
	}
	return count;
}

uint32_t kit_count_payloads(const struct kit_store *store)
{
	uint32_t count = 0;

	for (uint32_t i = 0; i < store->node_count; i++)
		count += store->nodes[i].payload_id != 0;
	return count;
}

void kit_check_served(struct kit_client *client, uint32_t first)
{
	(void)kit_want(client, 0, first, 20, WIRE_SET_RETIRE);
	kit_settle(client);
	assert_int_equal(kit_count_drawable(&client->stores[0]), 20);
}

/* ---- status ---- */

char *kit_status(struct kit_client *client)
{
	struct wire_status message = { .what = WIRE_STATUS_ALL };
	char *text = NULL;
	size_t text_bytes = 0;
	FILE *out = open_memstream(&text, &text_bytes);
	const struct wire_text *piece;

	wire_header_init(&message.header, WIRE_STATUS, sizeof(message));
	kit_send(client, &message, sizeof(message), -1);
	do {
		piece = kit_receive(client, WIRE_TEXT);
		(void)fwrite(piece->text, 1, piece->text_bytes, out);
	} while (!piece->last);
	(void)fclose(out);
	return text;
}

uint64_t kit_status_number(struct kit_client *client, const char *key)
{
	char *text = kit_status(client);
	char quoted[64];
	const char *at;
	uint64_t value;

	(void)snprintf(quoted, sizeof(quoted), "\"%s\":", key);
	at = strstr(text, quoted);
	if (!at)
		fail_msg("no %s in %s", quoted, text);
	value = strtoull(at + strlen(quoted), NULL, 10);
	free(text);
	return value;
}

void kit_await_number(struct kit_client *client, const char *key, uint64_t value)
{
	uint64_t now = 0;

	/* Each question is a round trip through the daemon's loop. */
	for (unsigned i = 0; i < 20000; i++) {
		now = kit_status_number(client, key);
		if (now == value)
			return;
	}
	fail_msg("%s stays %llu", key, (unsigned long long)now);
}
