/* SPDX-License-Identifier: MIT */
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "formats/base/check.h"
#include "formats/base/clock.h"
#include "formats/base/file.h"
#include "libclient/client_private.h"

struct ooc_store *store_destroy(struct ooc_store *store)
{
	if (!store)
		return NULL;

	store->view = view_destroy(store, store->view);
	while (store->old_views) {
		struct view *next = store->old_views->next;

		view_destroy(store, store->old_views);
		store->old_views = next;
	}
	mapping_done(&store->hs);
	store->fd = fd_close(store->fd);
	free(store->wants);
	free(store);
	return NULL;
}

/* Opens the file here, where the kernel judges by this process's rights. */
static int file_open(struct ooc_client *client, const char *path)
{
	struct stat status;
	int fd;

	/* Whatever stands there, opening it must not wait. */
	fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
	if (fd < 0)
		return why_errno(&client->why, -errno, "cannot be opened");
	if (fstat(fd, &status) < 0 || !S_ISREG(status.st_mode)) {
		(void)fd_close(fd);
		return why_set(&client->why, -EUCLEAN, "is no store: it is no regular file");
	}
	return fd;
}

/* Returns: a number that is free, or -EMFILE. */
static int number_find(const struct ooc_client *client)
{
	uint64_t taken = client->unanswered_opens | client->unsent_closes;

	for (uint32_t i = 0; i < WIRE_STORE_COUNT_MAX; i++) {
		if (!client->stores[i] && !(taken >> i & 1))
			return (int)i;
	}
	return -EMFILE;
}

/* ---- the protocol's side ---- */

int store_ask(struct ooc_store *store)
{
	struct wire_open *message = (struct wire_open *)(void *)store->client->outgoing;
	int r;

	*message = (struct wire_open){ .store = store->number };
	memcpy(message->path, store->path, sizeof(message->path));
	wire_header_init(&message->header, WIRE_OPEN, sizeof(*message));
	r = session_send(store->client, message, sizeof(*message), &store->fd, 1);
	if (r == 0)
		store->state = STORE_ASKED;
	return r;
}

static int close_say(struct ooc_client *client, uint32_t number)
{
	struct wire_close message = { .store = number };

	wire_header_init(&message.header, WIRE_CLOSE, sizeof(message));
	return session_send(client, &message, sizeof(message), NULL, 0);
}

static void close_say_or_note(struct ooc_client *client, uint32_t number)
{
	if (client->state == SESSION_LIVE && close_say(client, number) == -EAGAIN)
		client->unsent_closes |= UINT64_C(1) << number;
}

void store_flush_closes(struct ooc_client *client)
{
	for (uint32_t i = 0; i < WIRE_STORE_COUNT_MAX; i++) {
		uint64_t bit = UINT64_C(1) << i;

		if (!(client->unsent_closes & bit))
			continue;
		if (close_say(client, i) < 0)
			return;
		client->unsent_closes &= ~bit;
	}
}

/* The daemon serves it no longer: what is mapped stays as it is until the store is closed. */
static void store_become_lost(struct ooc_store *store, int error)
{
	store->state = STORE_LOST;
	store->error = error;
	/* ooc_open() tells of a store that never was open. */
	if (store->hs.base)
		store->client->a_store_was_lost = true;
}

/* Maps the HS and looks whether it is the one that OPENED speaks of. */
static int hs_map(struct ooc_store *store, const struct wire_opened *opened, int fd)
{
	struct why *why = &store->client->why;
	const struct store_superblock *superblock;
	int r;

	if (opened->node_count > STORE_NODE_COUNT_MAX ||
	    opened->hs_bytes < STORE_BLOCK_BYTES + opened->node_count * sizeof(struct store_node))
		return why_set(why, -EPROTO, "the daemon's HS is too short for %llu nodes",
			       (unsigned long long)opened->node_count);
	r = mapping_init(fd, opened->hs_bytes, &store->hs, why);
	if (r < 0)
		return r;
	superblock = store->hs.base;
	if (memcmp(superblock->magic, STORE_MAGIC, sizeof(superblock->magic)) != 0 ||
	    superblock->node_count != opened->node_count ||
	    superblock->generation != opened->generation ||
	    memcmp(superblock->uuid, opened->uuid, sizeof(opened->uuid)) != 0)
		return why_set(why, -EPROTO, "the daemon's HS is of another store");
	/* Zeros: no node is in any set.  Pages that no set touches take no memory. */
	store->wants = calloc(opened->node_count, sizeof(*store->wants));
	if (!store->wants)
		return why_set(why, -ENOMEM, "no memory for the sets of %llu nodes",
			       (unsigned long long)opened->node_count);
	store->superblock = superblock;
	store->nodes = (const struct store_node *)(const void *)((const uint8_t *)store->hs.base +
								 STORE_BLOCK_BYTES);
	store->node_count = opened->node_count;
	return 0;
}

static bool is_same_generation(const struct ooc_store *store, const struct wire_opened *opened)
{
	return opened->generation == store->superblock->generation &&
	       opened->node_count == store->node_count &&
	       memcmp(opened->uuid, store->superblock->uuid, sizeof(opened->uuid)) == 0;
}

int store_take_opened(struct ooc_client *client, const struct wire_opened *opened, const int *fds)
{
	struct ooc_store *store = client->stores[opened->store];
	uint64_t bit = UINT64_C(1) << opened->store;
	int r;

	if (client->unanswered_opens & bit) {
		client->unanswered_opens &= ~bit;
		close_say_or_note(client, opened->store);
		return 0;
	}
	if (!store || store->state != STORE_ASKED)
		return why_set(&client->why, -EPROTO, "the daemon opens a store unasked");
	if (store->hs.base && !is_same_generation(store, opened)) {
		/* Its nodes have other numbers: whoever walks the old HS must open the new one. */
		store_become_lost(store, -ESTALE);
		close_say_or_note(client, opened->store);
		return 0;
	}
	if (!store->hs.base) {
		r = hs_map(store, opened, fds[0]);
		if (r < 0)
			return r;
	}
	r = view_create(store, opened, fds[1], fds[2], &store->view);
	if (r < 0)
		return r;
	store->state = STORE_OPEN;
	return 0;
}

void store_take_error(struct ooc_client *client, const struct wire_error *error)
{
	struct ooc_store *store = client->stores[error->store];
	uint64_t bit = UINT64_C(1) << error->store;

	if (client->unanswered_opens & bit)
		client->unanswered_opens &= ~bit;
	else if (store && store->state == STORE_ASKED)
		store_become_lost(store, error->error);
}

/* ---- the public side ---- */

/* "…/far/away.ooc": what people know a file by is its end. */
static void path_copy(const char *path, char ret[WIRE_PATH_BYTES])
{
	static const char ellipsis[] = "...";
	size_t length = strlen(path);

	memset(ret, 0, WIRE_PATH_BYTES);
	if (length < WIRE_PATH_BYTES) {
		memcpy(ret, path, length);
		return;
	}
	memcpy(ret, ellipsis, sizeof(ellipsis) - 1);
	memcpy(ret + sizeof(ellipsis) - 1, path + length - (WIRE_PATH_BYTES - sizeof(ellipsis)),
	       WIRE_PATH_BYTES - sizeof(ellipsis));
}

static int wait_for_answer(struct ooc_store *store)
{
	struct ooc_client *client = store->client;
	uint64_t deadline_ns = clock_now_ns() + OPEN_TIMEOUT_NS;
	int r;

	while (store->state == STORE_UNASKED || store->state == STORE_ASKED) {
		r = session_run(client);
		if (r < 0)
			return r == -ENOMEM || r == -EPROTO ? r : -ENOTCONN;
		if (store->state == STORE_OPEN || store->state == STORE_LOST)
			break;
		if (clock_now_ns() >= deadline_ns)
			return why_set(&client->why, -ETIMEDOUT, "the daemon does not open it");
		session_pause(client, deadline_ns);
	}
	return store->state == STORE_LOST ? store->error : 0;
}

int ooc_open(struct ooc_client *client, const char *path, struct ooc_store **ret)
{
	struct ooc_store *store;
	int number;
	int r;

	number = number_find(client);
	if (number < 0)
		return why_set(&client->why, number, "%u stores are open, which is the limit",
			       WIRE_STORE_COUNT_MAX);
	store = calloc(1, sizeof(*store));
	if (!store)
		return why_set(&client->why, -ENOMEM, "no memory for a store");
	store->client = client;
	store->number = (uint32_t)number;
	path_copy(path, store->path);
	store->fd = file_open(client, path);
	if (store->fd < 0) {
		r = store->fd;
		goto err_destroy;
	}
	if (client->state != SESSION_LIVE) {
		r = why_set(&client->why, -ENOTCONN, "the daemon is away");
		goto err_destroy;
	}

	client->stores[number] = store;
	r = wait_for_answer(store);
	if (r < 0)
		goto err_forget;
	*ret = store;
	return 0;

err_forget:
	if (client->state == SESSION_LIVE && store->state == STORE_ASKED)
		client->unanswered_opens |= UINT64_C(1) << number;
	client->stores[number] = NULL;
err_destroy:
	store_destroy(store);
	return r;
}

struct ooc_store *ooc_close(struct ooc_store *store)
{
	struct ooc_client *client;

	if (!store)
		return NULL;
	client = store->client;
	set_drop_store(client, store);
	client->stores[store->number] = NULL;
	if (store->state == STORE_ASKED)
		client->unanswered_opens |= UINT64_C(1) << store->number;
	else if (store->state == STORE_OPEN)
		close_say_or_note(client, store->number);
	return store_destroy(store);
}

int ooc_store_error(const struct ooc_store *store)
{
	return store->state == STORE_LOST ? store->error : 0;
}

const struct store_superblock *ooc_superblock(const struct ooc_store *store)
{
	return store->superblock;
}

const struct store_node *ooc_nodes(const struct ooc_store *store)
{
	return store->nodes;
}

uint64_t ooc_node_count(const struct ooc_store *store)
{
	return store->node_count;
}
