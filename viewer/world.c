/* SPDX-License-Identifier: MIT */
#include "viewer/world.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "formats/base/log.h"

static int open_store(struct world *world, const char *path, struct why *why)
{
	struct world_store *store = &world->stores[world->store_count];
	double unit_metres;
	int r;

	store->path = strdup(path);
	if (!store->path)
		return why_errno(why, -ENOMEM, "%s", path);
	world->store_count++;
	r = ooc_open(world->client, path, &store->store);
	if (r < 0)
		return why_set(why, r, "%s: %s", path, ooc_error_text(world->client));
	store->superblock = ooc_superblock(store->store);
	store->nodes = ooc_nodes(store->store);
	r = selector_create(store->superblock, store->nodes, &store->selector);
	if (r < 0)
		return why_errno(why, r, "%s", path);

	if (world->store_count > 1) {
		const struct world_store *before = store - 1;

		store->first_seen = before->first_seen + (uint32_t)before->superblock->node_count;
	}
	unit_metres = world->stores[0].superblock->unit_metres;
	store->scale = 1.0;
	if (unit_metres > 0.0 && store->superblock->unit_metres > 0.0)
		store->scale = store->superblock->unit_metres / unit_metres;
	return 0;
}

int world_init(struct world *ret, const char *socket_path, const char *const *daemon_options,
	       char *const *paths, uint32_t path_count, struct why *why)
{
	struct world world = { 0 };
	int r;

	CHECK(path_count > 0);
	if (path_count > WORLD_STORE_COUNT_MAX)
		return why_set(why, -E2BIG, "%u stores: at most %u fit into one view", path_count,
			       WORLD_STORE_COUNT_MAX);
	r = ooc_connect_or_start(socket_path, "oocview", daemon_options, &world.client);
	if (r < 0)
		return why_set(why, r, "%s", ooc_error_text(NULL));
	for (uint32_t i = 0; i < path_count; i++) {
		r = open_store(&world, paths[i], why);
		if (r < 0) {
			world_done(&world);
			return r;
		}
	}
	*ret = world;
	return 0;
}

void world_done(struct world *world)
{
	for (uint32_t i = 0; i < world->store_count; i++) {
		selector_destroy(world->stores[i].selector);
		free(world->stores[i].path);
	}
	/* Closes the stores. */
	ooc_disconnect(world->client);
	free(world->wants);
	free(world->ooc_wants);
	memset(world, 0, sizeof(*world));
}

static bool has_box(const struct store_superblock *superblock)
{
	return superblock->triangle_count > 0;
}

bool world_box(const struct world *world, double ret_min[3], double ret_max[3])
{
	double least[3] = { INFINITY, INFINITY, INFINITY };
	double most[3] = { -INFINITY, -INFINITY, -INFINITY };

	for (uint32_t i = 0; i < world->store_count; i++) {
		const struct world_store *store = &world->stores[i];
		const struct store_superblock *superblock = store->superblock;

		if (!has_box(superblock))
			continue;
		for (int k = 0; k < 3; k++) {
			double origin = superblock->origin[k];

			least[k] = fmin(least[k], (origin + superblock->box_min[k]) * store->scale);
			most[k] = fmax(most[k], (origin + superblock->box_max[k]) * store->scale);
		}
	}
	if (!(least[0] <= most[0]))
		return false;
	memcpy(ret_min, least, sizeof(least));
	memcpy(ret_max, most, sizeof(most));
	return true;
}

/* The first store that knows decides. */
static uint32_t up_axis(const struct world *world)
{
	for (uint32_t i = 0; i < world->store_count; i++) {
		if (world->stores[i].superblock->up_axis != STORE_AXIS_UNKNOWN)
			return world->stores[i].superblock->up_axis;
	}
	return STORE_AXIS_Z;
}

void world_frame_all(const struct world *world, double aspect, double fov_y_degrees,
		     struct camera *ret)
{
	struct store_superblock whole = *world->stores[0].superblock;
	const struct store_superblock *superblocks[] = { &whole };
	double least[3] = { 0.0, 0.0, 0.0 };
	double most[3] = { 0.0, 0.0, 0.0 };

	/* One store as large as all, in the world's units. */
	(void)world_box(world, least, most);
	whole.up_axis = up_axis(world);
	for (int k = 0; k < 3; k++) {
		whole.origin[k] = 0.5 * (least[k] + most[k]);
		whole.box_min[k] = least[k] - whole.origin[k];
		whole.box_max[k] = most[k] - whole.origin[k];
	}
	camera_frame_all(ret, superblocks, 1, aspect, fov_y_degrees);
}

void world_up(const struct world *world, double ret[3])
{
	uint32_t axis = up_axis(world);

	for (uint32_t k = 0; k < 3; k++)
		ret[k] = axis == STORE_AXIS_X + k ? 1.0 : 0.0;
}

static void camera_scaled(const struct camera *camera, double scale, struct camera *ret)
{
	*ret = *camera;
	if (scale == 1.0)
		return;
	for (int k = 0; k < 3; k++) {
		ret->eye[k] = camera->eye[k] / scale;
		ret->at[k] = camera->at[k] / scale;
	}
}

int world_views(const struct world *world, const struct camera *camera, double aspect,
		struct camera_view *ret)
{
	struct camera scaled;
	double near = INFINITY;

	/* One near plane for all, so that their depths compare. */
	for (uint32_t i = 0; i < world->store_count; i++) {
		const struct world_store *store = &world->stores[i];

		camera_scaled(camera, store->scale, &scaled);
		near = fmin(near, camera_near(&scaled, store->superblock) * store->scale);
	}
	for (uint32_t i = 0; i < world->store_count; i++) {
		const struct world_store *store = &world->stores[i];
		int r;

		camera_scaled(camera, store->scale, &scaled);
		r = camera_view_init(&ret[i], &scaled, store->superblock, aspect,
				     near / store->scale);
		if (r < 0)
			return r;
	}
	return 0;
}

int world_point(struct world *world, const struct camera *camera, double aspect, struct why *why)
{
	struct camera_view views[WORLD_STORE_COUNT_MAX];
	int r = world_views(world, camera, aspect, views);

	if (r < 0)
		return why_set(why, r,
			       "the camera looks nowhere: eye, at and up must "
			       "be finite and give a direction");
	for (uint32_t i = 0; i < world->store_count; i++)
		world->stores[i].view = views[i];
	return 0;
}

void world_want_none(struct world *world)
{
	world->want_count = 0;
	world->want_triangles = 0;
}

static int reserve_wants(struct world *world, size_t count)
{
	size_t room = count + count / 2;
	void *wants;
	void *ooc_wants;

	if (count <= world->want_room)
		return 0;
	wants = realloc(world->wants, room * sizeof(*world->wants));
	if (!wants)
		return -ENOMEM;
	world->wants = wants;
	ooc_wants = realloc(world->ooc_wants, room * sizeof(*world->ooc_wants));
	if (!ooc_wants)
		return -ENOMEM;
	world->ooc_wants = ooc_wants;
	world->want_room = room;
	return 0;
}

int world_want(struct world *world, const struct world_want *want)
{
	int r = reserve_wants(world, world->want_count + 1);

	if (r < 0)
		return r;
	world->wants[world->want_count++] = *want;
	world->want_triangles += world->stores[want->store].nodes[want->node].triangle_count;
	return 0;
}

static int add_wants(struct world *world, uint32_t store, const struct selection *selection)
{
	for (size_t i = 0; i < selection->entry_count; i++) {
		const struct selection_entry *entry = &selection->entries[i];
		int r = world_want(world, &(struct world_want){ .store = store,
								.node = entry->node,
								.importance = entry->importance });

		if (r < 0)
			return r;
	}
	return 0;
}

/* Most important first; a store's own order stays, for its entries come in that order. */
static int compare_wants(const void *left, const void *right)
{
	const struct world_want *a = left;
	const struct world_want *b = right;

	if (a->importance != b->importance)
		return a->importance > b->importance ? -1 : 1;
	if (a->store != b->store)
		return a->store < b->store ? -1 : 1;
	return a->node < b->node ? -1 : a->node > b->node;
}

/* Cuts the list where the budget is spent; the first node always stays. */
static void apply_budget(struct world *world, uint64_t budget_triangles)
{
	uint64_t triangles = 0;
	size_t count = 0;

	while (count < world->want_count && (count == 0 || triangles < budget_triangles)) {
		const struct world_want *want = &world->wants[count++];

		triangles += world->stores[want->store].nodes[want->node].triangle_count;
	}
	world->want_count = count;
	world->want_triangles = triangles;
}

static bool fits(const struct world *world, uint64_t budget_triangles)
{
	uint64_t triangles = 0;

	for (uint32_t i = 0; i < world->store_count; i++)
		triangles += world->stores[i].superblock->triangle_count;
	return budget_triangles == 0 || triangles <= budget_triangles;
}

void world_want_sort(struct world *world)
{
	qsort(world->wants, world->want_count, sizeof(*world->wants), compare_wants);
}

int world_look(struct world *world, const struct camera *camera, double aspect,
	       const struct world_choice *choice, struct why *why)
{
	const struct select_options options = { .order = choice->order,
						.budget_triangles = choice->budget_triangles };
	int r = world_point(world, camera, aspect, why);

	if (r < 0)
		return r;
	world_want_none(world);
	world->nodes_visited = 0;
	world->fits_budget =
		choice->mode == WORLD_MODE_APPROXIMATE && fits(world, choice->budget_triangles);
	for (uint32_t i = 0; i < world->store_count; i++) {
		struct world_store *store = &world->stores[i];
		struct selection selection;

		if (choice->mode == WORLD_MODE_FULL || world->fits_budget)
			select_frustum(store->selector, &store->view, &selection);
		else
			select_approximate(store->selector, &store->view, &options, &selection);
		r = add_wants(world, i, &selection);
		if (r < 0)
			return why_errno(why, r, "the list of wanted nodes");
		world->nodes_visited += selection.nodes_visited;
	}
	if (world->store_count == 1)
		return 0;
	world_want_sort(world);
	if (choice->mode == WORLD_MODE_APPROXIMATE && !world->fits_budget)
		apply_budget(world, choice->budget_triangles);
	return 0;
}

int world_ask(struct world *world, size_t first, size_t count, struct why *why)
{
	int64_t serial;

	CHECK(first <= world->want_count && count <= world->want_count - first);
	for (size_t i = 0; i < count; i++) {
		const struct world_want *want = &world->wants[first + i];

		world->ooc_wants[i] = (struct ooc_want){
			.store = world->stores[want->store].store,
			.node = want->node,
			.importance = want->importance,
		};
	}
	serial = ooc_visible_set(world->client, world->ooc_wants, count);
	if (serial < 0)
		return why_set(why, (int)serial, "asking for %zu nodes: %s", count,
			       ooc_error_text(world->client));
	return 0;
}

void world_dispatch(struct world *world)
{
	if (ooc_dispatch(world->client) != -ESTALE)
		return;
	for (uint32_t i = 0; i < world->store_count; i++) {
		struct world_store *store = &world->stores[i];
		int error = ooc_store_error(store->store);

		if (error == 0 || store->is_lost)
			continue;
		store->is_lost = true;
		if (error == -ESTALE)
			log_warning("%s: it was built anew meanwhile: open it again to see that",
				    store->path);
		else
			log_warning("%s: the daemon serves it no longer: %s", store->path,
				    strerror(-error));
	}
}

double world_near(const struct world *world)
{
	return world->stores[0].view.near * world->stores[0].scale;
}
