/* SPDX-License-Identifier: MIT */
#include "viewer/foresight.h"

#include <errno.h>
#include <pthread.h>
#include <stdlib.h>

#include "formats/base/check.h"
#include "libclient/look_ahead.h"

/* How far ahead it looks, as `oocbench walk` does: farther, cameras are not predicted well enough. */
#define HORIZON_S 0.7

struct foresight {
	const struct world *world;
	struct selector *selectors[WORLD_STORE_COUNT_MAX];
	struct look_ahead *look_ahead;
	struct look_ahead_budget budget;

	/* What the look-ahead's thread reads of the newest frame. */
	pthread_mutex_t lock;
	double aspect;
	struct world_choice choice;
};

static void choose(const struct world_choice *choice, struct selector *selector,
		   const struct camera_view *view, struct selection *ret)
{
	const struct select_options options = { .order = choice->order,
						.budget_triangles = choice->budget_triangles };

	if (choice->mode == WORLD_MODE_FULL)
		select_frustum(selector, view, ret);
	else
		select_approximate(selector, view, &options, ret);
}

/* A look_ahead_choose_fn: reads of the world what never changes. */
static size_t choose_ahead(void *arg, const struct camera *camera, struct ooc_want *ret)
{
	struct foresight *foresight = arg;
	const struct world *world = foresight->world;
	struct camera_view views[WORLD_STORE_COUNT_MAX];
	struct world_choice choice;
	double aspect;
	size_t count = 0;

	(void)pthread_mutex_lock(&foresight->lock);
	aspect = foresight->aspect;
	choice = foresight->choice;
	(void)pthread_mutex_unlock(&foresight->lock);
	if (world_views(world, camera, aspect, views) < 0)
		return 0;
	for (uint32_t i = 0; i < world->store_count; i++) {
		struct selection selection;

		choose(&choice, foresight->selectors[i], &views[i], &selection);
		for (size_t k = 0; k < selection.entry_count && count < LOOK_AHEAD_WANT_COUNT_MAX;
		     k++)
			ret[count++] = (struct ooc_want){ .store = world->stores[i].store,
							  .node = selection.entries[k].node };
	}
	return count;
}

int foresight_create(const struct world *world, uint64_t frame_bytes, struct foresight **ret,
		     struct why *why)
{
	struct foresight *foresight = calloc(1, sizeof(*foresight));
	struct look_ahead_config config = { .choose = choose_ahead,
					    .choose_arg = foresight,
					    .horizon_s = HORIZON_S };
	int r = 0;

	if (!foresight)
		return why_errno(why, -ENOMEM, "looking ahead");
	foresight->world = world;
	foresight->budget = (struct look_ahead_budget){ .bytes = frame_bytes,
							.requests = LOOK_AHEAD_WANT_COUNT_MAX };
	foresight->aspect = 1.0;
	(void)pthread_mutex_init(&foresight->lock, NULL);
	for (uint32_t i = 0; i < world->store_count && r == 0; i++)
		r = selector_create(world->stores[i].superblock, world->stores[i].nodes,
				    &foresight->selectors[i]);
	if (r == 0)
		r = look_ahead_create(&config, &foresight->look_ahead);
	if (r < 0) {
		foresight_destroy(foresight);
		return why_errno(why, r, "looking ahead");
	}
	*ret = foresight;
	return 0;
}

struct foresight *foresight_destroy(struct foresight *foresight)
{
	if (!foresight)
		return NULL;
	look_ahead_destroy(foresight->look_ahead);
	for (uint32_t i = 0; i < WORLD_STORE_COUNT_MAX; i++)
		selector_destroy(foresight->selectors[i]);
	(void)pthread_mutex_destroy(&foresight->lock);
	free(foresight);
	return NULL;
}

void foresight_frame(struct foresight *foresight, const struct camera *camera, double aspect,
		     const struct world_choice *choice)
{
	struct look_ahead_report report;

	CHECK(choice->mode != WORLD_MODE_CONSERVATIVE);
	(void)pthread_mutex_lock(&foresight->lock);
	foresight->aspect = aspect;
	foresight->choice = *choice;
	(void)pthread_mutex_unlock(&foresight->lock);
	look_ahead_see(foresight->look_ahead, camera);
	/* What could not be asked for in this frame is asked for in the next. */
	(void)look_ahead_send(foresight->look_ahead, foresight->world->client, &foresight->budget,
			      &report);
}

size_t foresight_expected(struct foresight *foresight, struct ooc_want *ret)
{
	return look_ahead_expected(foresight->look_ahead, ret);
}
