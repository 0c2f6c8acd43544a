/* SPDX-License-Identifier: MIT */
/*
 * The client library when things go wrong with the daemon: it is lost and comes back, says what it
 * must not, shares what cannot be believed, or is no daemon at all.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include "formats/base/file.h"
#include "tests/helper.h"
#include "tests/unit/fake_daemon.h"

/* A daemon that died is noticed within a tenth of a second: no test waits longer, or for a clock. */
static int dispatch_until_away(struct ooc_client *client)
{
	int r;

	do
		r = ooc_dispatch(client);
	while (r == 0);
	return r;
}

/* The daemon takes over the set that it is told next, and has all of it. */
static void serve_next(struct fake_scene *scene)
{
	const struct wire_set *set = fake_expect_set(scene->fake, 0);

	for (uint32_t i = 0; i < set->entry_count; i++) {
		fake_grant(scene->fake, 0, set->entries[i].node, true);
		fake_ready(scene->fake, 0, set->entries[i].node, 0, 10 + i);
	}
	fake_settle(scene->fake, set->serial);
}

static bool is_payload(const struct fake_scene *scene, uint32_t node)
{
	const uint8_t *bytes = ooc_map(scene->store, node);

	for (uint32_t i = 0; bytes && i < FAKE_PAYLOAD_BYTES; i++)
		assert_int_equal(bytes[i], (uint8_t)node);
	return bytes != NULL;
}

/* Waits for the client's back-off to end with it having connected, and takes its HELLO. */
static void come_back(struct fake_scene *scene)
{
	struct pollfd knock = { .fd = scene->fake->listen_fd, .events = POLLIN };

	do
		(void)ooc_dispatch(scene->client);
	while (poll(&knock, 1, 1) == 0);
	fake_accept(scene->fake);
}

static void greet_again(struct fake_scene *scene)
{
	come_back(scene);
	fake_welcome(scene->fake);
	assert_int_equal(ooc_dispatch(scene->client), 0);
}

/* ---- lost and found ---- */

static void a_lost_daemon_takes_nothing_away(void **state)
{
	struct fake_scene *scene = *state;
	struct ooc_counters counters;
	struct ooc_place place;

	(void)fake_give(scene, 1, 2);
	serve_next(scene);
	assert_int_equal(ooc_locate(scene->store, 1, &place), 0);
	fake_die(scene->fake);
	assert_int_equal(dispatch_until_away(scene->client), -ENOTCONN);
	assert_int_equal(ooc_dispatch(scene->client), -ENOTCONN);
	assert_int_equal(ooc_fd(scene->client), -1);
	assert_true(is_payload(scene, 1));
	assert_true(is_payload(scene, 2));
	assert_true(ooc_still_valid(scene->store, 1, &place));
	/* What is wanted now has to wait; what was there stays. */
	assert_true(fake_give(scene, 2, 2) > 0);
	assert_false(is_payload(scene, 1));
	assert_true(is_payload(scene, 2));
	assert_false(is_payload(scene, 3));
	ooc_counters(scene->client, &counters);
	assert_int_equal(counters.reconnects, 0);
}

static void after_a_loss_stores_are_opened_and_the_set_is_said_again(void **state)
{
	struct fake_scene *scene = *state;
	struct ooc_counters counters;
	struct ooc_place before;
	struct ooc_place after;
	const struct wire_set *set;

	(void)fake_give(scene, 1, 2);
	serve_next(scene);
	fake_die(scene->fake);
	greet_again(scene);
	assert_int_equal(ooc_locate(scene->store, 1, &before), 0);

	/* The set waits for the store; what was drawable is all the while. */
	fake_serve_open(scene->fake);
	assert_true(is_payload(scene, 1));
	assert_int_equal(ooc_dispatch(scene->client), 0);
	set = fake_expect_set(scene->fake, 0);
	assert_int_equal(set->entry_count, 2);
	assert_int_equal(set->entries[0].node, 1);
	assert_true(is_payload(scene, 1));
	assert_true(ooc_still_valid(scene->store, 1, &before));

	/* Half of it is there: the new place counts for that half. */
	fake_grant(scene->fake, 0, 1, true);
	fake_ready(scene->fake, 0, 1, 0, 20);
	fake_acknowledge(scene->fake, set->serial);
	assert_true(is_payload(scene, 1));
	assert_true(is_payload(scene, 2));
	assert_int_equal(ooc_locate(scene->store, 1, &after), 0);
	assert_int_not_equal(after.fill, before.fill);
	assert_int_not_equal(after.segment, before.segment);

	/* Settled: the old memory is let go. */
	fake_grant(scene->fake, 0, 2, true);
	fake_ready(scene->fake, 0, 2, 0, 21);
	fake_settle(scene->fake, set->serial);
	assert_int_equal(ooc_dispatch(scene->client), 0);
	assert_true(is_payload(scene, 1));
	assert_true(is_payload(scene, 2));
	assert_false(ooc_still_valid(scene->store, 1, &before));
	assert_true(ooc_still_valid(scene->store, 1, &after));
	ooc_counters(scene->client, &counters);
	assert_int_equal(counters.reconnects, 1);
}

static void drawing_threads_keep_old_memory_until_they_retire_it(void **state)
{
	struct fake_scene *scene = *state;
	const uint8_t *bytes;
	int64_t serial;

	ooc_keep_drawing(scene->client, true);
	(void)fake_give(scene, 1, 1);
	serve_next(scene);
	bytes = ooc_map(scene->store, 1);
	fake_die(scene->fake);
	greet_again(scene);
	fake_serve_open(scene->fake);
	assert_int_equal(ooc_dispatch(scene->client), 0);
	serve_next(scene);
	assert_int_equal(ooc_dispatch(scene->client), 0);
	assert_ptr_not_equal(ooc_map(scene->store, 1), bytes);
	assert_int_equal(bytes[0], 1);

	serial = fake_give(scene, 1, 2);
	serve_next(scene);
	assert_int_equal(bytes[FAKE_PAYLOAD_BYTES - 1], 1);
	assert_int_equal(ooc_retire(scene->client, serial), 0);
	assert_true(is_payload(scene, 1));
}

static void a_daemon_lost_often_before_it_is_settled_takes_nothing_away(void **state)
{
	struct fake_scene *scene = *state;

	(void)fake_give(scene, 1, 2);
	serve_next(scene);
	for (int i = 0; i < 6; i++) {
		fake_die(scene->fake);
		greet_again(scene);
		fake_serve_open(scene->fake);
		assert_int_equal(ooc_dispatch(scene->client), 0);
		assert_true(is_payload(scene, 1));
		assert_true(is_payload(scene, 2));
	}
	serve_next(scene);
	assert_int_equal(ooc_dispatch(scene->client), 0);
	assert_true(is_payload(scene, 1));
}

static void old_memory_that_threads_may_draw_from_is_bounded(void **state)
{
	struct fake_scene *scene = *state;
	struct pollfd knock = { .fd = scene->fake->listen_fd, .events = POLLIN };
	int64_t serial;

	ooc_keep_drawing(scene->client, true);
	serial = fake_give(scene, 1, 1);
	for (int i = 0; i < 4; i++) {
		serve_next(scene);
		fake_die(scene->fake);
		greet_again(scene);
		fake_serve_open(scene->fake);
		assert_int_equal(ooc_dispatch(scene->client), 0);
	}
	/* The first of four is still drawn from: no fifth comes before it is retired. */
	fake_die(scene->fake);
	assert_int_equal(dispatch_until_away(scene->client), -ENOTCONN);
	for (int i = 0; i < 50; i++) {
		(void)ooc_dispatch(scene->client);
		assert_int_equal(poll(&knock, 1, 1), 0);
	}
	assert_true(is_payload(scene, 1));
	serial = fake_give(scene, 1, 2);
	assert_int_equal(ooc_retire(scene->client, serial), 0);
	greet_again(scene);
	fake_serve_open(scene->fake);
	assert_int_equal(ooc_dispatch(scene->client), 0);
	serve_next(scene);
	assert_true(is_payload(scene, 2));
}

static void a_client_that_was_thrown_out_finds_out_without_a_call(void **state)
{
	struct fake_scene *scene = *state;
	struct wire_grants *grants = scene->fake->stores[0].grants.base;
	struct ooc_place place;

	(void)fake_give(scene, 1, 1);
	serve_next(scene);
	assert_int_equal(ooc_locate(scene->store, 1, &place), 0);
	atomic_store_explicit(&grants->epoch, 0, memory_order_release);
	assert_false(is_payload(scene, 1));
	assert_false(ooc_still_valid(scene->store, 1, &place));
}

static void a_successor_that_takes_the_memory_over_ends_what_was_drawable(void **state)
{
	struct fake_scene *scene = *state;
	struct wire_directory *directory = scene->fake->stores[0].directory.base;

	(void)fake_give(scene, 1, 1);
	serve_next(scene);
	atomic_store_explicit(&directory->epoch, scene->fake->epoch + 1, memory_order_release);
	assert_false(is_payload(scene, 1));
}

static void another_generation_is_told_once_and_leaves_the_old_one_drawable(void **state)
{
	struct fake_scene *scene = *state;
	struct ooc_progress progress;

	(void)fake_give(scene, 1, 2);
	serve_next(scene);
	fake_die(scene->fake);
	scene->fake->generation = 2;
	greet_again(scene);
	fake_serve_open(scene->fake);
	assert_int_equal(ooc_dispatch(scene->client), -ESTALE);
	assert_int_equal(ooc_dispatch(scene->client), 0);
	assert_int_equal(ooc_store_error(scene->store), -ESTALE);
	(void)fake_expect(scene->fake, WIRE_CLOSE);
	assert_int_equal(fake_expect_set(scene->fake, 0)->entry_count, 0);
	assert_true(is_payload(scene, 1));
	assert_true(fake_give(scene, 2, 2) > 0);
	assert_int_equal(ooc_not_now(scene->store, 3), OOC_REASON_LOST);
	ooc_progress(scene->client, &progress);
	assert_int_equal(progress.drawable_count, 1);

	/* Closed and opened, it is the new one. */
	ooc_close(scene->store);
	fake_die(scene->fake);
	scene->store = NULL;
	greet_again(scene);
	assert_int_equal(fake_expect_set(scene->fake, 0)->entry_count, 0);
	scene->store = fake_open(scene->fake, scene->client);
	assert_int_equal(ooc_superblock(scene->store)->generation, 2);
	assert_int_equal(ooc_store_error(scene->store), 0);
}

static void a_wait_outlives_the_daemon(void **state)
{
	struct fake_scene *scene = *state;

	(void)fake_give(scene, 1, 1);
	fake_die(scene->fake);
	assert_int_equal(ooc_wait(scene->client, 30), -ENOTCONN);
	come_back(scene);
	fake_welcome(scene->fake);
	(void)ooc_wait(scene->client, 0);
	fake_serve_open(scene->fake);
	(void)ooc_wait(scene->client, 0);
	serve_next(scene);
	assert_int_equal(ooc_wait(scene->client, 10000), 0);
	assert_true(is_payload(scene, 1));
}

static void functions_that_need_the_daemon_say_that_it_is_away(void **state)
{
	struct fake_scene *scene = *state;
	struct ooc_want want = { scene->store, 1, 1 };
	struct ooc_store *store;
	char *text;

	fake_die(scene->fake);
	assert_int_equal(dispatch_until_away(scene->client), -ENOTCONN);
	assert_int_equal(ooc_open(scene->client, scene->fake->store_path, &store), -ENOTCONN);
	assert_int_equal(ooc_status(scene->client, &text), -ENOTCONN);
	assert_int_equal(ooc_prefetch(scene->client, &want, 1), -ENOTCONN);
	assert_int_equal(ooc_retire(scene->client, 0), 0);
}

/* ---- what cannot be believed ---- */

/* Sends bytes as they are; the client must end the session, say why, and keep no descriptor. */
static void assert_ends_session(struct fake_scene *scene, const void *bytes, size_t size_bytes,
				size_t fd_count)
{
	struct test_descriptors before;
	int fds[4] = { 0, 0, 0, 0 };

	test_descriptors_note(&before);
	assert_int_equal(
		wire_send(scene->fake->fd, bytes, size_bytes, fds, fd_count > 3 ? 3 : fd_count), 0);
	assert_int_equal(dispatch_until_away(scene->client), -ENOTCONN);
	assert_true(ooc_error_text(scene->client)[0] != '\0');
	assert_int_equal(test_descriptors_leaked(&before), 0);
	/* It comes back as if nothing had been. */
	fake_die(scene->fake);
	greet_again(scene);
	fake_serve_open(scene->fake);
	assert_int_equal(ooc_dispatch(scene->client), 0);
}

static void garbage_ends_the_session_and_leaks_nothing(void **state)
{
	struct fake_scene *scene = *state;
	_Alignas(8) uint8_t bytes[600] = { 0 };
	struct wire_header *header = (void *)bytes;
	struct wire_opened opened = { .segment_bytes_log2 = 20 };
	struct wire_segment segment = { .segment_bytes = 4096 };
	struct wire_text text = { .last = 1 };
	struct wire_welcome welcome = { .epoch = 7, .page_bytes = 4096, .version = WIRE_VERSION };

	assert_ends_session(scene, bytes, 1, 0);
	assert_ends_session(scene, bytes, sizeof(bytes), 0);
	assert_ends_session(scene, bytes, sizeof(bytes), 3);
	wire_header_init(header, WIRE_SET, 24);
	assert_ends_session(scene, bytes, 24, 0);
	wire_header_init(header, WIRE_EVENT, 32);
	assert_ends_session(scene, bytes, 31, 0);
	assert_ends_session(scene, bytes, 32, 1);
	wire_header_init(&opened.header, WIRE_OPENED, sizeof(opened));
	assert_ends_session(scene, &opened, sizeof(opened), 3);
	wire_header_init(&segment.header, WIRE_SEGMENT, sizeof(segment));
	assert_ends_session(scene, &segment, sizeof(segment), 1);
	wire_header_init(&text.header, WIRE_TEXT, sizeof(text));
	assert_ends_session(scene, &text, sizeof(text), 0);
	wire_header_init(&welcome.header, WIRE_WELCOME, sizeof(welcome));
	assert_ends_session(scene, &welcome, sizeof(welcome), 1);
}

static void memory_that_could_shrink_is_not_mapped(void **state)
{
	struct fake_scene *scene = *state;

	scene->fake->seals = 0;
	fake_segment(scene->fake, 0, 1);
	assert_int_equal(dispatch_until_away(scene->client), -ENOTCONN);
	assert_non_null(strstr(ooc_error_text(scene->client), "shrink"));
}

static void memory_shorter_than_it_is_said_to_be_is_not_mapped(void **state)
{
	struct fake_scene *scene = *state;
	struct fake_memory memory = fake_memory_make(scene->fake, 4096);
	struct wire_segment segment = { .segment = 1, .segment_bytes = 8192 };

	fake_send(scene->fake, &segment, WIRE_SEGMENT, sizeof(segment), &memory.fd, 1);
	assert_int_equal(dispatch_until_away(scene->client), -ENOTCONN);
	assert_non_null(strstr(ooc_error_text(scene->client), "4096 bytes and says 8192"));
	fake_memory_free(&memory);
}

/* A change to OPENED, or to the memory that comes with it, that the client has to notice. */
enum lie {
	LIE_NONE,
	LIE_NODE_COUNT,
	LIE_DIRECTORY_SHORT,
	LIE_GRANTS_SHORT,
	LIE_HS_SHORT,
	LIE_MAGIC,
	LIE_UUID,
	LIE_DIRECTORY_OF_ANOTHER,
	LIE_COUNT_
};

struct liar {
	struct fake_daemon *fake;
	enum lie lie;
};

static void *open_with_a_lie(void *arg)
{
	struct liar *liar = arg;
	struct fake_daemon *fake = liar->fake;
	uint32_t number = ((const struct wire_open *)fake_expect(fake, WIRE_OPEN))->store;
	struct wire_opened opened = {
		.store = number,
		.segment_bytes_log2 = 20,
		.generation = 1,
		.node_count = liar->lie == LIE_NODE_COUNT ? UINT64_MAX / 64 : 2,
		.hs_bytes = liar->lie == LIE_HS_SHORT ? 4096 + 255 : 4096 + 256,
		.directory_bytes = liar->lie == LIE_DIRECTORY_SHORT ? 64 + 15 : 64 + 16,
		.grants_bytes = liar->lie == LIE_GRANTS_SHORT ? 64 + 7 : 64 + 8,
	};
	struct fake_memory hs = fake_memory_make(fake, 8192);
	struct fake_memory directory = fake_memory_make(fake, 4096);
	struct fake_memory grants = fake_memory_make(fake, 4096);
	struct store_superblock *superblock = hs.base;
	struct wire_directory *words = directory.base;

	memcpy(superblock->magic, liar->lie == LIE_MAGIC ? "OOCSTORM" : STORE_MAGIC, 8);
	superblock->node_count = 2;
	superblock->generation = 1;
	opened.uuid[0] = liar->lie == LIE_UUID;
	words->generation = 1;
	words->node_count = liar->lie == LIE_DIRECTORY_OF_ANOTHER ? 3 : 2;
	((struct wire_grants *)grants.base)->node_count = 2;
	fake_send(fake, &opened, WIRE_OPENED, sizeof(opened),
		  (int[]){ hs.fd, directory.fd, grants.fd }, 3);
	fake_memory_free(&hs);
	fake_memory_free(&directory);
	fake_memory_free(&grants);
	return NULL;
}

static void a_store_that_does_not_fit_its_description_is_not_opened(void **state)
{
	struct fake_scene *scene = *state;
	struct liar liar = { .fake = scene->fake };
	struct ooc_store *store;
	pthread_t thread;

	for (liar.lie = LIE_NONE; liar.lie < LIE_COUNT_; liar.lie++) {
		assert_int_equal(pthread_create(&thread, NULL, open_with_a_lie, &liar), 0);
		assert_int_equal(ooc_open(scene->client, scene->fake->store_path, &store),
				 liar.lie == LIE_NONE ? 0 : -EPROTO);
		assert_int_equal(pthread_join(thread, NULL), 0);
		if (liar.lie == LIE_NONE) {
			assert_int_equal(ooc_node_count(store), 2);
			ooc_close(store);
			(void)fake_expect(scene->fake, WIRE_CLOSE);
			continue;
		}
		fake_die(scene->fake);
		greet_again(scene);
		fake_serve_open(scene->fake);
		assert_int_equal(ooc_dispatch(scene->client), 0);
	}
}

/* ---- no daemon, or not ours ---- */

static void *refuse_version(void *arg)
{
	struct fake_daemon *fake = arg;
	struct wire_error error = {
		.error = -EPROTONOSUPPORT,
		.type = WIRE_HELLO,
		.version = 99,
		.text = "another version",
	};

	fake_accept(fake);
	fake_send(fake, &error, WIRE_ERROR, sizeof(error), NULL, 0);
	return NULL;
}

static void a_daemon_of_another_version_is_named(void **state)
{
	struct fake_daemon *fake = fake_create(*state);
	struct ooc_client *client;
	pthread_t thread;

	assert_int_equal(pthread_create(&thread, NULL, refuse_version, fake), 0);
	assert_int_equal(ooc_connect(fake->path, "test", &client), -EPROTONOSUPPORT);
	assert_int_equal(pthread_join(thread, NULL), 0);
	assert_null(client);
	assert_non_null(strstr(ooc_error_text(NULL), "version 99"));
	fake_destroy(fake);
}

static void somebody_who_accepts_and_says_nothing_is_given_up(void **state)
{
	struct fake_daemon *fake = fake_create(*state);
	struct ooc_client *client;

	assert_int_equal(ooc_connect(fake->path, "test", &client), -ETIMEDOUT);
	assert_non_null(strstr(ooc_error_text(NULL), "does not answer"));
	fake_destroy(fake);
}

static void nobody_listening_is_said_at_once(void **state)
{
	struct fake_daemon *fake = fake_create(*state);
	struct ooc_client *client;

	/* An old socket file, a file that is no socket, nothing at all. */
	fake->listen_fd = fd_close(fake->listen_fd);
	assert_int_equal(ooc_connect(fake->path, "test", &client), -ECONNREFUSED);
	assert_non_null(strstr(ooc_error_text(NULL), fake->path));
	assert_int_equal(ooc_connect(fake->store_path, "test", &client), -ECONNREFUSED);
	assert_int_equal(ooc_connect(test_path(*state, "nothing"), "test", &client), -ENOENT);
	fake_destroy(fake);
}

static void a_socket_of_another_kind_is_no_daemon(void **state)
{
	struct sockaddr_un address = { .sun_family = AF_UNIX };
	struct ooc_client *client;
	int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);

	(void)strcpy(address.sun_path, test_path(*state, "stream"));
	assert_int_equal(bind(fd, (struct sockaddr *)&address, sizeof(address)), 0);
	assert_int_equal(listen(fd, 1), 0);
	assert_int_equal(ooc_connect(address.sun_path, "test", &client), -ECONNREFUSED);
	(void)fd_close(fd);
}

static void a_path_that_is_no_address_is_too_long(void **state)
{
	struct ooc_client *client;
	char path[300];

	(void)state;
	memset(path, 'x', sizeof(path) - 1);
	path[sizeof(path) - 1] = '\0';
	assert_int_equal(ooc_connect(path, "test", &client), -ENAMETOOLONG);
}

#define SCENE_TEST(test)                                                                           \
	cmocka_unit_test_setup_teardown(test, fake_scene_setup, fake_scene_teardown)
#define FOLDER_TEST(test)                                                                          \
	cmocka_unit_test_setup_teardown(test, test_folder_setup, test_folder_teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {
		SCENE_TEST(a_lost_daemon_takes_nothing_away),
		SCENE_TEST(after_a_loss_stores_are_opened_and_the_set_is_said_again),
		SCENE_TEST(drawing_threads_keep_old_memory_until_they_retire_it),
		SCENE_TEST(a_daemon_lost_often_before_it_is_settled_takes_nothing_away),
		SCENE_TEST(old_memory_that_threads_may_draw_from_is_bounded),
		SCENE_TEST(a_client_that_was_thrown_out_finds_out_without_a_call),
		SCENE_TEST(a_successor_that_takes_the_memory_over_ends_what_was_drawable),
		SCENE_TEST(another_generation_is_told_once_and_leaves_the_old_one_drawable),
		SCENE_TEST(a_wait_outlives_the_daemon),
		SCENE_TEST(functions_that_need_the_daemon_say_that_it_is_away),
		SCENE_TEST(garbage_ends_the_session_and_leaks_nothing),
		SCENE_TEST(memory_that_could_shrink_is_not_mapped),
		SCENE_TEST(memory_shorter_than_it_is_said_to_be_is_not_mapped),
		SCENE_TEST(a_store_that_does_not_fit_its_description_is_not_opened),
		FOLDER_TEST(a_daemon_of_another_version_is_named),
		FOLDER_TEST(somebody_who_accepts_and_says_nothing_is_given_up),
		FOLDER_TEST(nobody_listening_is_said_at_once),
		FOLDER_TEST(a_socket_of_another_kind_is_no_daemon),
		FOLDER_TEST(a_path_that_is_no_address_is_too_long),
	};

	return TEST_RUN(tests);
}
