/* SPDX-License-Identifier: MIT */
/* Looking ahead through the real library and a real daemon; the camera's place says what it wants. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdlib.h>

#include "formats/base/bytes.h"
#include "libclient/look_ahead.h"
#include "tests/helper.h"
#include "tests/integration/daemon_kit.h"

#define LEAF_COUNT_MAX 512u
/* A leaf a unit of way, and a unit of way a frame. */
#define FRAME_S   (1.0 / 30.0)
#define HORIZON_S (20.0 * FRAME_S)

struct scene {
	char *folder;
	struct kit_daemon daemon;
	struct ooc_client *client;
	struct ooc_store *store;
	uint32_t leaves[LEAF_COUNT_MAX];
	uint32_t leaf_count;
	_Atomic uint32_t choice_count;
};

static void wait_a_moment(void)
{
	(void)poll(NULL, 0, 2);
}

static int scene_setup(void **state)
{
	struct scene *scene = calloc(1, sizeof(*scene));
	struct server_config config = kit_config();
	const struct store_node *nodes;

	scene->folder = test_folder_make();
	test_store_grid(test_path(scene->folder, "m.ooc"), 16);
	kit_daemon_start(scene->folder, &config, &scene->daemon);
	assert_int_equal(ooc_connect(scene->daemon.socket_path, "test", &scene->client), 0);
	assert_int_equal(ooc_open(scene->client, test_path(scene->folder, "m.ooc"), &scene->store),
			 0);
	nodes = ooc_nodes(scene->store);
	for (uint32_t i = 0; i < ooc_node_count(scene->store); i++)
		if (nodes[i].payload_id != 0 && scene->leaf_count < LEAF_COUNT_MAX)
			scene->leaves[scene->leaf_count++] = i;
	assert_true(scene->leaf_count > 200);
	*state = scene;
	return 0;
}

static int scene_teardown(void **state)
{
	struct scene *scene = *state;

	ooc_disconnect(scene->client);
	assert_int_equal(kit_daemon_stop(&scene->daemon, SIGTERM), 0);
	test_folder_remove(scene->folder);
	free(scene);
	return 0;
}

static struct camera camera_at(double way, double time_s)
{
	return (struct camera){ .time_s = time_s,
				.eye = { way, 0.0, 0.0 },
				.at = { way + 1.0, 0.0, 0.0 },
				.up = { 0.0, 0.0, 1.0 },
				.fov_y_degrees = 60.0 };
}

/* Two leaves: the one that the camera has come to, and the next. */
static size_t choose(void *arg, const struct camera *camera, struct ooc_want *ret)
{
	struct scene *scene = arg;
	uint32_t leaf = (uint32_t)(camera->eye[0] + 0.5);

	for (uint32_t i = 0; i < 2; i++)
		ret[i] = (struct ooc_want){ scene->store,
					    scene->leaves[(leaf + i) % scene->leaf_count], 0.0f };
	atomic_fetch_add(&scene->choice_count, 1);
	return 2;
}

static bool is_ready(const struct scene *scene, uint32_t leaf)
{
	return ooc_node_state(scene->store, scene->leaves[leaf]) == OOC_STATE_READY;
}

static const struct look_ahead_budget plenty = { .bytes = GIB, .requests = 1000 };

/* Goes on showing the same camera until a leaf has come, which nobody has put into a set. */
static void wait_for(struct scene *scene, struct look_ahead *look_ahead, uint32_t leaf)
{
	struct look_ahead_report report;

	for (int i = 0; i < 5000 && !is_ready(scene, leaf); i++) {
		(void)look_ahead_send(look_ahead, scene->client, &plenty, &report);
		assert_int_equal(ooc_dispatch(scene->client), 0);
		wait_a_moment();
	}
	assert_true(is_ready(scene, leaf));
}

static struct look_ahead *create(struct scene *scene, const struct camera *path, size_t path_count)
{
	struct look_ahead_config config = { choose, scene, HORIZON_S, path, path_count };
	struct look_ahead *look_ahead;

	assert_int_equal(look_ahead_create(&config, &look_ahead), 0);
	return look_ahead;
}

static void what_a_moving_camera_will_want_is_there_before_it_comes(void **state)
{
	struct scene *scene = *state;
	struct look_ahead *look_ahead = create(scene, NULL, 0);

	for (int i = 5; i < 9; i++) {
		struct camera camera = camera_at(i, i * FRAME_S);

		look_ahead_see(look_ahead, &camera);
	}
	wait_for(scene, look_ahead, 8 + 20);
	/* Reads end in any order. */
	wait_for(scene, look_ahead, 8 + 1);
	/*
	 * Nothing behind the first camera, which the thread may have seen alone, and nothing
	 * beyond the horizon.
	 */
	assert_false(is_ready(scene, 4));
	assert_false(is_ready(scene, 8 + 23));
	look_ahead_destroy(look_ahead);
}

static void a_path_that_is_known_is_followed_through_its_jumps(void **state)
{
	struct scene *scene = *state;
	struct camera path[30];
	struct look_ahead *look_ahead;

	for (int i = 0; i < 30; i++)
		path[i] = camera_at(i < 10 ? i : 150 + i, i * FRAME_S);
	look_ahead = create(scene, path, ARRAY_LENGTH(path));
	for (int i = 0; i < 3; i++)
		look_ahead_see(look_ahead, &path[i]);
	wait_for(scene, look_ahead, 150 + 2 + 20);
	assert_false(is_ready(scene, 2 + 20));
	look_ahead_destroy(look_ahead);
}

static void a_frame_asks_for_no_more_than_its_budget(void **state)
{
	struct scene *scene = *state;
	struct look_ahead *look_ahead = create(scene, NULL, 0);
	struct look_ahead_report report = { .requests = 0 };
	struct camera camera;
	uint64_t bytes;

	for (int i = 0; i < 4; i++) {
		camera = camera_at(i, i * FRAME_S);
		look_ahead_see(look_ahead, &camera);
	}
	while (report.requests == 0) {
		const struct look_ahead_budget two = { .bytes = GIB, .requests = 2 };

		assert_int_equal(look_ahead_send(look_ahead, scene->client, &two, &report), 0);
		assert_true(report.requests <= 2);
		wait_a_moment();
	}
	bytes = ooc_nodes(scene->store)[scene->leaves[0]].stored_bytes;
	for (int i = 0; i < 20; i++) {
		const struct look_ahead_budget less = { .bytes = bytes - 1, .requests = 1000 };

		assert_int_equal(look_ahead_send(look_ahead, scene->client, &less, &report), 0);
		assert_int_equal(report.requests, 0);
	}
	look_ahead_destroy(look_ahead);
}

static void what_is_there_already_is_not_asked_for_again(void **state)
{
	struct scene *scene = *state;
	struct look_ahead *look_ahead = create(scene, NULL, 0);
	struct look_ahead_report report;

	for (int i = 0; i < 4; i++) {
		struct camera camera = camera_at(i, i * FRAME_S);

		look_ahead_see(look_ahead, &camera);
	}
	wait_for(scene, look_ahead, 3 + 20);
	do {
		assert_int_equal(look_ahead_send(look_ahead, scene->client, &plenty, &report), 0);
		wait_a_moment();
	} while (report.requests > 0);
	assert_int_equal(report.bytes, 0);
	assert_true(report.reach_s == HORIZON_S);
	look_ahead_destroy(look_ahead);
}

static void a_look_ahead_ends_while_its_thread_is_at_work(void **state)
{
	struct scene *scene = *state;

	for (int i = 0; i < 50; i++) {
		struct look_ahead *look_ahead = create(scene, NULL, 0);
		struct camera camera = camera_at(i, i * FRAME_S);

		look_ahead_see(look_ahead, &camera);
		if (i % 2)
			while (atomic_load(&scene->choice_count) == 0)
				wait_a_moment();
		look_ahead_destroy(look_ahead);
	}
}

static void without_a_camera_nothing_is_asked_for(void **state)
{
	struct scene *scene = *state;
	struct look_ahead *look_ahead = create(scene, NULL, 0);
	struct look_ahead_report report;

	assert_int_equal(look_ahead_send(look_ahead, scene->client, &plenty, &report), 0);
	assert_int_equal(report.requests, 0);
	look_ahead_destroy(look_ahead);
}

#define IN_SCENE(test) cmocka_unit_test_setup_teardown(test, scene_setup, scene_teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {
		IN_SCENE(what_a_moving_camera_will_want_is_there_before_it_comes),
		IN_SCENE(a_path_that_is_known_is_followed_through_its_jumps),
		IN_SCENE(a_frame_asks_for_no_more_than_its_budget),
		IN_SCENE(what_is_there_already_is_not_asked_for_again),
		IN_SCENE(a_look_ahead_ends_while_its_thread_is_at_work),
		IN_SCENE(without_a_camera_nothing_is_asked_for),
	};

	return TEST_RUN(tests);
}
