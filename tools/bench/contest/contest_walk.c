/* SPDX-License-Identifier: MIT */
/* What a walk wants, frame by frame. */
#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/store/store_file.h"
#include "libclient/select/camera.h"
#include "libclient/select/select.h"
#include "tools/bench/contest/contest.h"
#include "tools/bench/path/path.h"

/** Nodes side by side in the file that are in the same frames. */
#define STRETCH_NODES 32u
#define ASPECT        (4.0 / 3.0)

static int load_nodes(struct contest_walk *walk, struct why *why)
{
	struct store_file *store;
	int r = store_open_path(walk->store, &store, why);

	if (r < 0)
		return r;
	walk->superblock = *store_superblock(store);
	walk->nodes = calloc(walk->superblock.node_count + 1, sizeof(*walk->nodes));
	r = walk->nodes ? store_load_hs(store, walk->nodes, why)
			: why_set(why, -ENOMEM, "out of memory");
	store_close(store);
	for (uint64_t i = 0; r == 0 && i < walk->superblock.node_count; i++)
		if (walk->nodes[i].payload_id != 0 && walk->nodes[i].codec != STORE_CODEC_NONE)
			r = why_set(why, -ENOTSUP,
				    "%s: its payloads are coded, which nobody else could read: "
				    "build it with --codec none",
				    walk->store);
	return r;
}

static int load_cameras(const char *store, const char *path, enum path_kind kind,
			size_t frame_count, struct camera **ret, uint32_t *ret_count,
			struct why *why)
{
	struct path made;
	int r;

	if (path)
		return camera_path_read(path, ret, ret_count, why);
	r = path_make(store, kind, frame_count, 1, &made, why);
	if (r == -ENODATA && kind == PATH_WALK)
		r = path_make(store, PATH_ORBIT, frame_count, 1, &made, why);
	if (r < 0)
		return r;
	*ret = made.cameras;
	*ret_count = (uint32_t)made.camera_count;
	return 0;
}

/* The stretches of one parity, then those of the other: no frame has a node of the one before. */
static void frame_keep(struct contest_walk *walk, const struct selection *selection,
		       size_t frame_number, uint8_t *seen)
{
	struct contest_frame *frame = &walk->frames[walk->frame_count];
	uint32_t *nodes = walk->node_memory + walk->read_count;
	uint64_t bytes = 0;
	size_t count = 0;

	for (size_t i = 0; i < selection->entry_count; i++) {
		uint32_t node = selection->entries[i].node;

		if (node / STRETCH_NODES % 2 != frame_number % 2)
			continue;
		nodes[count++] = node;
		bytes += walk->nodes[node].payload_bytes;
		if (!seen[node])
			walk->distinct_bytes += walk->nodes[node].payload_bytes;
		seen[node] = 1;
	}
	*frame = (struct contest_frame){ nodes, count };
	walk->frame_count++;
	walk->read_count += count;
	walk->read_bytes += bytes;
	walk->largest_bytes = u64_max(walk->largest_bytes, bytes);
}

static int select_frames(struct contest_walk *walk, const struct camera *cameras,
			 uint32_t camera_count, size_t frame_count, uint64_t budget,
			 struct why *why)
{
	struct select_options options = { SELECT_ORDER_AUTO, budget };
	size_t entry_count_max = 0;
	struct selector *selector;
	struct selection selection;
	uint8_t *seen = NULL;
	int r = selector_create(&walk->superblock, walk->nodes, &selector);

	if (r < 0)
		return why_set(why, r, "out of memory");
	for (uint64_t i = 0; i < walk->superblock.node_count; i++)
		entry_count_max += walk->nodes[i].payload_id != 0;
	seen = calloc(walk->superblock.node_count, 1);
	walk->node_memory = malloc(frame_count * entry_count_max * sizeof(uint32_t) + 1);
	if (!seen || !walk->node_memory)
		r = why_set(why, -ENOMEM, "out of memory");
	for (size_t i = 0; r == 0 && i < frame_count; i++) {
		const struct camera *camera = &cameras[i * camera_count / frame_count];
		struct camera_view view;

		r = camera_view_init(&view, camera, &walk->superblock, ASPECT,
				     camera_near(camera, &walk->superblock));
		if (r < 0) {
			(void)why_set(why, r, "a camera of the path has no direction");
			break;
		}
		select_approximate(selector, &view, &options, &selection);
		frame_keep(walk, &selection, i, seen);
	}
	if (r == 0 && walk->read_count == 0)
		r = why_set(why, -ENODATA, "%s: the path sees nothing of it", walk->store);
	free(seen);
	selector_destroy(selector);
	return r;
}

int contest_walk_make(const char *store, const char *path, enum path_kind kind, size_t frame_count,
		      uint64_t budget, struct contest_walk *ret, struct why *why)
{
	struct camera *cameras = NULL;
	uint32_t camera_count;
	int r;

	memset(ret, 0, sizeof(*ret));
	if (!realpath(store, ret->store))
		return why_errno(why, -errno, "%s", store);
	r = load_nodes(ret, why);
	if (r == 0)
		r = load_cameras(ret->store, path, kind, frame_count, &cameras, &camera_count, why);
	if (r == 0)
		r = select_frames(ret, cameras, camera_count,
				  u64_min(frame_count, CONTEST_FRAME_COUNT_MAX), budget, why);
	free(cameras);
	if (r < 0)
		contest_walk_done(ret);
	return r;
}

void contest_walk_done(struct contest_walk *walk)
{
	free(walk->nodes);
	free(walk->node_memory);
	walk->nodes = NULL;
	walk->node_memory = NULL;
}
