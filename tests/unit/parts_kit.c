/* SPDX-License-Identifier: MIT */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "tests/unit/parts_kit.h"

#include <fcntl.h>
#include <poll.h>

static void on_make(void *arg, struct served *served)
{
	struct parts *parts = arg;
	struct memfile memfile;
	struct segment *segment;

	assert_int_equal(memfile_create("test", served->arena.segment_bytes, false, &memfile, NULL),
			 0);
	assert_int_equal(memfile_publish(&memfile, MEMFILE_CHANGING, NULL), 0);
	assert_int_equal(cache_add_segment(&parts->cache, served, &memfile, &segment), 0);
	segment->buffer = FETCH_BUFFER_NONE;
}

static void on_gone(void *arg, struct served *served, struct segment *segment)
{
	(void)arg;
	(void)served;
	(void)segment;
}

void parts_begin(struct parts *parts, uint64_t budget_bytes, const struct test_grid *grid,
		 const struct fetch_sim *sim, fills_ended_fn ended, void *ended_arg)
{
	const struct cache_calls calls = { .make = on_make, .gone = on_gone };
	struct fetch_config fetch_config = {
		.kind = FETCH_SIM, .depth = PARTS_DEPTH, .done = fills_read_done, .sim = *sim
	};
	struct why why;
	const char *path;

	parts->folder = test_folder_make();
	path = test_path(parts->folder, "a.ooc");
	test_store_grid_make(path, grid);
	cache_init(&parts->cache, budget_bytes, &calls, parts);
	assert_int_equal(workers_create(1, &parts->workers, &why), 0);
	assert_int_equal(
		fills_create(&parts->cache, parts->workers, ended, ended_arg, &parts->fills, &why),
		0);
	fetch_config.done_arg = parts->fills;
	assert_int_equal(fetch_create(&fetch_config, &parts->fetch, &why), 0);
	fills_set_fetch(parts->fills, parts->fetch);
	if (served_open(open(path, O_RDONLY | O_CLOEXEC), path, budget_bytes, 1, &parts->served,
			&why) < 0)
		fail_msg("%s", why.text);
	assert_int_equal(fills_prepare(parts->fills, parts->served, &why), 0);
	assert_int_equal(fetch_add_file(parts->fetch, parts->served->fd, &parts->served->file), 0);
	cache_add_store(&parts->cache, parts->served);
	for (uint32_t i = 0; i < parts->served->node_count && parts->node_count < PARTS_NODES_MAX;
	     i++)
		if (served_has_payload(parts->served, i))
			parts->nodes[parts->node_count++] = i;
}

void parts_end(struct parts *parts)
{
	cache_remove_store(&parts->cache, parts->served);
	workers_destroy(parts->workers);
	fetch_destroy(parts->fetch);
	fills_destroy(parts->fills);
	served_close(parts->served);
	test_folder_remove(parts->folder);
}

void parts_take_reads(struct parts *parts)
{
	struct pollfd fds[] = {
		{ .fd = fetch_fd(parts->fetch), .events = POLLIN },
		{ .fd = workers_fd(parts->workers), .events = POLLIN },
	};

	assert_true(poll(fds, 2, 20000) > 0);
	if (fds[0].revents)
		fetch_dispatch(parts->fetch);
	fetch_flush(parts->fetch);
	fills_verify(parts->fills);
	if (fds[1].revents)
		workers_dispatch(parts->workers);
}
