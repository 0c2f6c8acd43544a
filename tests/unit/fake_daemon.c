/* SPDX-License-Identifier: MIT */
#include "tests/unit/fake_daemon.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/un.h>

#include "formats/base/file.h"
#include "tests/helper.h"

#define PATIENCE_MS 10000

_Noreturn void fake_failed(const char *condition, const char *file, int line)
{
	(void)fprintf(stderr, "%s:%d: the fake daemon finds that %s does not hold\n", file, line,
		      condition);
	abort();
}

/* ---- memory ---- */

struct fake_memory fake_memory_make(const struct fake_daemon *fake, uint64_t bytes)
{
	struct fake_memory memory = { .bytes = bytes };

	memory.fd = memfd_create("fake", MFD_CLOEXEC | MFD_ALLOW_SEALING);
	FAKE_CHECK(memory.fd >= 0);
	FAKE_CHECK(ftruncate(memory.fd, (off_t)bytes) == 0);
	FAKE_CHECK(fake->seals == 0 || fcntl(memory.fd, F_ADD_SEALS, fake->seals) == 0);
	memory.base = mmap(NULL, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, memory.fd, 0);
	FAKE_CHECK(memory.base != MAP_FAILED);
	return memory;
}

void fake_memory_free(struct fake_memory *memory)
{
	if (memory->base)
		(void)munmap(memory->base, memory->bytes);
	if (memory->base)
		(void)fd_close(memory->fd);
	*memory = (struct fake_memory){ .fd = -1 };
}

static struct wire_session_page *page_of(struct fake_daemon *fake)
{
	return fake->page.base;
}

static struct wire_directory *directory_of(struct fake_daemon *fake, uint32_t store)
{
	return fake->stores[store].directory.base;
}

static struct wire_grants *grants_of(struct fake_daemon *fake, uint32_t store)
{
	return fake->stores[store].grants.base;
}

/* ---- life ---- */

struct fake_daemon *fake_create(const char *folder)
{
	struct fake_daemon *fake = calloc(1, sizeof(*fake));
	struct sockaddr_un address = { .sun_family = AF_UNIX };
	int fd;

	FAKE_CHECK(fake);
	fake->fd = -1;
	fake->passed_fd = -1;
	fake->epoch = 100;
	fake->generation = 1;
	fake->seals = F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_SEAL;
	(void)snprintf(fake->path, sizeof(fake->path), "%s/sock", folder);
	(void)snprintf(fake->store_path, sizeof(fake->store_path), "%s/fake.ooc", folder);
	fd = open(fake->store_path, O_WRONLY | O_CREAT | O_CLOEXEC, 0600);
	FAKE_CHECK(fd >= 0);
	(void)fd_close(fd);

	fake->listen_fd = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0);
	FAKE_CHECK(fake->listen_fd >= 0);
	(void)snprintf(address.sun_path, sizeof(address.sun_path), "%s", fake->path);
	FAKE_CHECK(bind(fake->listen_fd, (struct sockaddr *)&address, sizeof(address)) == 0);
	FAKE_CHECK(listen(fake->listen_fd, 16) == 0);
	return fake;
}

void fake_die(struct fake_daemon *fake)
{
	fake->fd = fd_close(fake->fd);
	fake->passed_fd = fd_close(fake->passed_fd);
	fake_memory_free(&fake->page);
	for (uint32_t i = 0; i < FAKE_STORE_COUNT; i++) {
		struct fake_store *store = &fake->stores[i];

		fake_memory_free(&store->hs);
		fake_memory_free(&store->directory);
		fake_memory_free(&store->grants);
		for (uint32_t k = 0; k < FAKE_SEGMENT_COUNT; k++)
			fake_memory_free(&store->segments[k]);
		store->is_open = false;
	}
	fake->epoch++;
}

void fake_destroy(struct fake_daemon *fake)
{
	fake_die(fake);
	(void)fd_close(fake->listen_fd);
	free(fake);
}

/* ---- messages ---- */

static void wait_readable(int fd)
{
	struct pollfd readable = { .fd = fd, .events = POLLIN };

	FAKE_CHECK(poll(&readable, 1, PATIENCE_MS) == 1);
}

const void *fake_expect(struct fake_daemon *fake, enum wire_type type)
{
	const struct wire_header *header = (const void *)fake->message;
	int fds[WIRE_FD_COUNT_MAX];
	size_t fd_count = 0;
	struct why why;
	int r;

	fake->passed_fd = fd_close(fake->passed_fd);
	wait_readable(fake->fd);
	r = wire_receive(fake->fd, fake->message, fds, &fd_count);
	FAKE_CHECK(r > 0);
	FAKE_CHECK(wire_check(WIRE_FROM_CLIENT, fake->message, (size_t)r, fd_count, &why) == 0);
	if (header->type != type)
		(void)fprintf(stderr, "%s came where %s was expected\n",
			      wire_type_name(header->type), wire_type_name(type));
	FAKE_CHECK(header->type == type);
	if (fd_count > 0)
		fake->passed_fd = fds[0];
	return fake->message;
}

void fake_expect_nothing(struct fake_daemon *fake)
{
	int fds[WIRE_FD_COUNT_MAX];
	size_t fd_count;

	FAKE_CHECK(wire_receive(fake->fd, fake->message, fds, &fd_count) == -EAGAIN);
}

const struct wire_set *fake_expect_set(struct fake_daemon *fake, uint64_t serial)
{
	const struct wire_set *set = fake_expect(fake, WIRE_SET);

	FAKE_CHECK(serial == 0 || set->serial == serial);
	FAKE_CHECK((set->flags & WIRE_SET_FIRST) && (set->flags & WIRE_SET_LAST));
	return set;
}

void fake_send(struct fake_daemon *fake, void *message, enum wire_type type, size_t bytes,
	       const int *fds, size_t fd_count)
{
	wire_header_init(message, type, bytes);
	FAKE_CHECK(wire_check(WIRE_FROM_DAEMON, message, bytes, fd_count, NULL) == 0);
	FAKE_CHECK(wire_send(fake->fd, message, bytes, fds, fd_count) == 0);
	if (page_of(fake))
		atomic_fetch_add_explicit(&page_of(fake)->message_count, 1, memory_order_release);
}

void fake_accept(struct fake_daemon *fake)
{
	wait_readable(fake->listen_fd);
	FAKE_CHECK(fake->fd < 0);
	fake->fd = accept4(fake->listen_fd, NULL, NULL, SOCK_CLOEXEC);
	FAKE_CHECK(fake->fd >= 0);
	(void)fake_expect(fake, WIRE_HELLO);
}

void fake_welcome(struct fake_daemon *fake)
{
	struct wire_welcome welcome = {
		.version = WIRE_VERSION,
		.session = 1,
		.epoch = fake->epoch,
		.page_bytes = WIRE_PAGE_BYTES,
	};

	fake->page = fake_memory_make(fake, WIRE_PAGE_BYTES);
	page_of(fake)->epoch = fake->epoch;
	fake_send(fake, &welcome, WIRE_WELCOME, sizeof(welcome), &fake->page.fd, 1);
}

static void hs_fill(struct fake_daemon *fake, struct fake_store *store)
{
	struct store_superblock *superblock = store->hs.base;
	struct store_node *nodes =
		(struct store_node *)(void *)((uint8_t *)store->hs.base + STORE_BLOCK_BYTES);

	memcpy(superblock->magic, STORE_MAGIC, sizeof(superblock->magic));
	superblock->version = STORE_VERSION;
	superblock->node_count = FAKE_NODE_COUNT;
	superblock->generation = fake->generation;
	for (uint32_t i = 1; i < FAKE_NODE_COUNT; i++) {
		nodes[i].payload_id = i;
		nodes[i].payload_bytes = FAKE_PAYLOAD_BYTES;
	}
}

void fake_serve_open(struct fake_daemon *fake)
{
	const struct wire_open *open = fake_expect(fake, WIRE_OPEN);
	struct fake_store *store = &fake->stores[open->store];
	struct wire_opened opened = {
		.store = open->store,
		.segment_bytes_log2 = 20,
		.generation = fake->generation,
		.node_count = FAKE_NODE_COUNT,
		.hs_bytes = STORE_BLOCK_BYTES + FAKE_NODE_COUNT * sizeof(struct store_node),
		.directory_bytes = sizeof(struct wire_directory) + 8 * FAKE_NODE_COUNT,
		.grants_bytes = sizeof(struct wire_grants) + 8 * (FAKE_NODE_COUNT / 64 + 1),
	};

	FAKE_CHECK(fake->passed_fd >= 0);
	store->hs = fake_memory_make(fake, opened.hs_bytes);
	store->directory = fake_memory_make(fake, opened.directory_bytes);
	store->grants = fake_memory_make(fake, opened.grants_bytes);
	store->is_open = true;
	hs_fill(fake, store);
	directory_of(fake, opened.store)->generation = fake->generation;
	directory_of(fake, opened.store)->node_count = FAKE_NODE_COUNT;
	directory_of(fake, opened.store)->epoch = fake->epoch;
	grants_of(fake, opened.store)->node_count = FAKE_NODE_COUNT;
	grants_of(fake, opened.store)->epoch = fake->epoch;
	fake_send(fake, &opened, WIRE_OPENED, sizeof(opened),
		  (int[]){ store->hs.fd, store->directory.fd, store->grants.fd }, 3);
	fake_segment(fake, opened.store, 0);
}

void fake_segment(struct fake_daemon *fake, uint32_t store, uint32_t segment)
{
	struct fake_memory *memory = &fake->stores[store].segments[segment % FAKE_SEGMENT_COUNT];
	struct wire_segment message = {
		.store = store,
		.segment = segment,
		.segment_bytes = FAKE_SEGMENT_BYTES,
	};

	if (!memory->base)
		*memory = fake_memory_make(fake, FAKE_SEGMENT_BYTES);
	fake_send(fake, &message, WIRE_SEGMENT, sizeof(message), &memory->fd, 1);
}

void fake_segment_gone(struct fake_daemon *fake, uint32_t store, uint32_t segment)
{
	struct wire_segment_gone message = { .store = store, .segment = segment };

	fake_memory_free(&fake->stores[store].segments[segment % FAKE_SEGMENT_COUNT]);
	fake_send(fake, &message, WIRE_SEGMENT_GONE, sizeof(message), NULL, 0);
}

void fake_event(struct fake_daemon *fake, uint64_t serial, bool settled)
{
	struct wire_event message = { .serial = serial, .settled = settled, .complete = settled };

	fake_send(fake, &message, WIRE_EVENT, sizeof(message), NULL, 0);
}

void fake_refuse(struct fake_daemon *fake, uint64_t serial, uint32_t store, uint32_t node,
		 uint32_t reason)
{
	_Alignas(8)
		uint8_t bytes[sizeof(struct wire_not_now) + sizeof(struct wire_refusal)] = { 0 };
	struct wire_not_now *message = (void *)bytes;

	message->serial = serial;
	message->entry_count = 1;
	message->entries[0] =
		(struct wire_refusal){ .store = store, .node = node, .reason = reason };
	fake_send(fake, message, WIRE_NOT_NOW, sizeof(bytes), NULL, 0);
}

/* ---- shared memory ---- */

void fake_acknowledge(struct fake_daemon *fake, uint64_t serial)
{
	atomic_store_explicit(&page_of(fake)->acknowledged, serial, memory_order_release);
}

void fake_settle(struct fake_daemon *fake, uint64_t serial)
{
	fake_acknowledge(fake, serial);
	atomic_store_explicit(&page_of(fake)->settled, serial, memory_order_release);
}

void fake_grant(struct fake_daemon *fake, uint32_t store, uint32_t node, bool granted)
{
	_Atomic uint64_t *word = &grants_of(fake, store)->words[node / 64];
	uint64_t bit = UINT64_C(1) << (node % 64);

	atomic_store_explicit(word, granted ? *word | bit : *word & ~bit, memory_order_release);
}

void fake_word(struct fake_daemon *fake, uint32_t store, uint32_t node, uint64_t word)
{
	atomic_store_explicit(&directory_of(fake, store)->words[node], word, memory_order_release);
}

void fake_ready(struct fake_daemon *fake, uint32_t store, uint32_t node, uint32_t segment,
		uint32_t page)
{
	uint8_t *base = fake->stores[store].segments[segment % FAKE_SEGMENT_COUNT].base;
	uint64_t fill_count = wire_word_fill_count(directory_of(fake, store)->words[node]) + 1;

	memset(base + (size_t)page * WIRE_PAGE_BYTES, (uint8_t)node, FAKE_PAYLOAD_BYTES);
	fake_word(fake, store, node, wire_word(WIRE_NODE_READY, segment, page, fill_count));
}

/* ---- the client's calls that wait ---- */

static void *greet(void *arg)
{
	fake_accept(arg);
	fake_welcome(arg);
	return NULL;
}

struct ooc_client *fake_connect(struct fake_daemon *fake)
{
	struct ooc_client *client;
	pthread_t thread;

	FAKE_CHECK(pthread_create(&thread, NULL, greet, fake) == 0);
	FAKE_CHECK(ooc_connect(fake->path, "test", &client) == 0);
	FAKE_CHECK(pthread_join(thread, NULL) == 0);
	return client;
}

static void *serve_open(void *arg)
{
	fake_serve_open(arg);
	return NULL;
}

struct ooc_store *fake_open(struct fake_daemon *fake, struct ooc_client *client)
{
	struct ooc_store *store;
	pthread_t thread;

	FAKE_CHECK(pthread_create(&thread, NULL, serve_open, fake) == 0);
	FAKE_CHECK(ooc_open(client, fake->store_path, &store) == 0);
	FAKE_CHECK(pthread_join(thread, NULL) == 0);
	FAKE_CHECK(ooc_dispatch(client) == 0);
	return store;
}

/* ---- a client with one store open, and its daemon ---- */

int fake_scene_setup(void **state)
{
	struct fake_scene *scene = calloc(1, sizeof(*scene));

	scene->folder = test_folder_make();
	scene->fake = fake_create(scene->folder);
	scene->client = fake_connect(scene->fake);
	scene->store = fake_open(scene->fake, scene->client);
	*state = scene;
	return 0;
}

int fake_scene_teardown(void **state)
{
	struct fake_scene *scene = *state;

	ooc_disconnect(scene->client);
	fake_destroy(scene->fake);
	test_folder_remove(scene->folder);
	free(scene);
	return 0;
}

int64_t fake_give(const struct fake_scene *scene, uint32_t first, uint32_t count)
{
	static struct ooc_want wants[FAKE_NODE_COUNT];

	for (uint32_t i = 0; i < count; i++)
		wants[i] = (struct ooc_want){ scene->store, first + i, (float)(count - i) };
	return ooc_visible_set(scene->client, wants, count);
}
