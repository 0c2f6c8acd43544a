/* SPDX-License-Identifier: MIT */
#include "viewer/scene.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "formats/base/log.h"

static int open_store(struct scene *scene, const char *path, struct why *why)
{
	struct scene_store *store = &scene->stores[scene->store_count];
	double unit_metres;
	int r;

	store->path = strdup(path);
	if (!store->path)
		return why_errno(why, -ENOMEM, "%s", path);
	scene->store_count++;
	r = ooc_open(scene->client, path, &store->store);
	if (r < 0)
		return why_set(why, r, "%s: %s", path, ooc_error_text(scene->client));
	store->superblock = ooc_superblock(store->store);
	store->nodes = ooc_nodes(store->store);
	r = selector_create(store->superblock, store->nodes, &store->selector);
	if (r < 0)
		return why_errno(why, r, "%s", path);

	unit_metres = scene->stores[0].superblock->unit_metres;
	store->scale = 1.0;
	if (unit_metres > 0.0 && store->superblock->unit_metres > 0.0)
		store->scale = store->superblock->unit_metres / unit_metres;
	return 0;
}

int scene_init(struct scene *ret, const char *socket_path, char *const *paths, uint32_t path_count,
	       struct why *why)
{
	struct scene scene = { 0 };
	int r;

	CHECK(path_count > 0);
	if (path_count > SCENE_STORE_COUNT_MAX)
		return why_set(why, -E2BIG, "%u stores: at most %u fit into one view", path_count,
			       SCENE_STORE_COUNT_MAX);
	r = ooc_connect(socket_path, "oocview", &scene.client);
	if (r < 0)
		return why_set(why, r, "%s", ooc_error_text(NULL));
	for (uint32_t i = 0; i < path_count; i++) {
		r = open_store(&scene, paths[i], why);
		if (r < 0) {
			scene_done(&scene);
			return r;
		}
	}
	*ret = scene;
	return 0;
}

void scene_done(struct scene *scene)
{
	for (uint32_t i = 0; i < scene->store_count; i++) {
		selector_destroy(scene->stores[i].selector);
		free(scene->stores[i].path);
	}
	/* Closes the stores. */
	ooc_disconnect(scene->client);
	free(scene->wants);
	free(scene->ooc_wants);
	memset(scene, 0, sizeof(*scene));
}

static bool has_box(const struct store_superblock *superblock)
{
	return superblock->triangle_count > 0;
}

bool scene_box(const struct scene *scene, double ret_min[3], double ret_max[3])
{
	double least[3] = { INFINITY, INFINITY, INFINITY };
	double most[3] = { -INFINITY, -INFINITY, -INFINITY };

	for (uint32_t i = 0; i < scene->store_count; i++) {
		const struct scene_store *store = &scene->stores[i];
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

void scene_frame_all(const struct scene *scene, double aspect, double fov_y_degrees,
		     struct camera *ret)
{
	struct store_superblock world = *scene->stores[0].superblock;
	const struct store_superblock *superblocks[] = { &world };
	double least[3] = { 0.0, 0.0, 0.0 };
	double most[3] = { 0.0, 0.0, 0.0 };

	/* One store as large as all: it has the first one's up axis and the world's units. */
	(void)scene_box(scene, least, most);
	for (int k = 0; k < 3; k++) {
		world.origin[k] = 0.5 * (least[k] + most[k]);
		world.box_min[k] = least[k] - world.origin[k];
		world.box_max[k] = most[k] - world.origin[k];
	}
	camera_frame_all(ret, superblocks, 1, aspect, fov_y_degrees);
}

void scene_up(const struct scene *scene, double ret[3])
{
	uint32_t axis = STORE_AXIS_UNKNOWN;

	/* As camera_frame_all(): the first store that knows decides. */
	for (uint32_t i = 0; i < scene->store_count && axis == STORE_AXIS_UNKNOWN; i++)
		axis = scene->stores[i].superblock->up_axis;
	if (axis == STORE_AXIS_UNKNOWN)
		axis = STORE_AXIS_Z;
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

static int make_views(struct scene *scene, const struct camera *camera, double aspect,
		      struct why *why)
{
	struct camera scaled;
	double near = INFINITY;

	/* One near plane for all, so that their depths compare. */
	for (uint32_t i = 0; i < scene->store_count; i++) {
		struct scene_store *store = &scene->stores[i];

		camera_scaled(camera, store->scale, &scaled);
		near = fmin(near, camera_near(&scaled, store->superblock) * store->scale);
	}
	for (uint32_t i = 0; i < scene->store_count; i++) {
		struct scene_store *store = &scene->stores[i];
		int r;

		camera_scaled(camera, store->scale, &scaled);
		r = camera_view_init(&store->view, &scaled, store->superblock, aspect,
				     near / store->scale);
		if (r < 0)
			return why_set(why, r,
				       "the camera looks nowhere: eye, at and up must "
				       "be finite and give a direction");
	}
	return 0;
}

static int add_wants(struct scene *scene, uint32_t store, const struct selection *selection)
{
	size_t count = scene->want_count + selection->entry_count;

	if (count > scene->want_room) {
		size_t room = count + count / 2;
		void *wants = realloc(scene->wants, room * sizeof(*scene->wants));
		void *ooc_wants;

		if (!wants)
			return -ENOMEM;
		scene->wants = wants;
		ooc_wants = realloc(scene->ooc_wants, room * sizeof(*scene->ooc_wants));
		if (!ooc_wants)
			return -ENOMEM;
		scene->ooc_wants = ooc_wants;
		scene->want_room = room;
	}
	for (size_t i = 0; i < selection->entry_count; i++) {
		const struct selection_entry *entry = &selection->entries[i];

		scene->wants[scene->want_count++] = (struct scene_want){
			.store = store, .node = entry->node, .importance = entry->importance
		};
	}
	return 0;
}

/* Most important first; a store's own order stays, for its entries come in that order. */
static int compare_wants(const void *left, const void *right)
{
	const struct scene_want *a = left;
	const struct scene_want *b = right;

	if (a->importance != b->importance)
		return a->importance > b->importance ? -1 : 1;
	if (a->store != b->store)
		return a->store < b->store ? -1 : 1;
	return a->node < b->node ? -1 : a->node > b->node;
}

/* Cuts the list where the budget is spent; the first node always stays. */
static void apply_budget(struct scene *scene, uint64_t budget_triangles)
{
	uint64_t triangles = 0;
	size_t count = 0;

	while (count < scene->want_count && (count == 0 || triangles < budget_triangles)) {
		const struct scene_want *want = &scene->wants[count++];

		triangles += scene->stores[want->store].nodes[want->node].triangle_count;
	}
	scene->want_count = count;
	scene->want_triangles = triangles;
}

int scene_look(struct scene *scene, const struct camera *camera, double aspect,
	       enum scene_mode mode, uint64_t budget_triangles, struct why *why)
{
	int r = make_views(scene, camera, aspect, why);

	if (r < 0)
		return r;
	scene->want_count = 0;
	scene->want_triangles = 0;
	for (uint32_t i = 0; i < scene->store_count; i++) {
		struct scene_store *store = &scene->stores[i];
		struct selection selection;

		if (mode == SCENE_MODE_FULL)
			select_frustum(store->selector, &store->view, &selection);
		else
			select_layers(store->selector, &store->view, budget_triangles, &selection);
		r = add_wants(scene, i, &selection);
		if (r < 0)
			return why_errno(why, r, "the list of wanted nodes");
		scene->want_triangles += selection.triangle_count;
	}
	if (scene->store_count == 1)
		return 0;
	qsort(scene->wants, scene->want_count, sizeof(*scene->wants), compare_wants);
	if (mode == SCENE_MODE_APPROXIMATE && budget_triangles > 0)
		apply_budget(scene, budget_triangles);
	return 0;
}

int scene_ask(struct scene *scene, size_t first, size_t count, struct why *why)
{
	int64_t serial;

	CHECK(first <= scene->want_count && count <= scene->want_count - first);
	for (size_t i = 0; i < count; i++) {
		const struct scene_want *want = &scene->wants[first + i];

		scene->ooc_wants[i] = (struct ooc_want){
			.store = scene->stores[want->store].store,
			.node = want->node,
			.importance = want->importance,
		};
	}
	serial = ooc_visible_set(scene->client, scene->ooc_wants, count);
	if (serial < 0)
		return why_set(why, (int)serial, "asking for %zu nodes: %s", count,
			       ooc_error_text(scene->client));
	return 0;
}

void scene_dispatch(struct scene *scene)
{
	if (ooc_dispatch(scene->client) != -ESTALE)
		return;
	for (uint32_t i = 0; i < scene->store_count; i++) {
		struct scene_store *store = &scene->stores[i];
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

double scene_near(const struct scene *scene)
{
	return scene->stores[0].view.near * scene->stores[0].scale;
}
