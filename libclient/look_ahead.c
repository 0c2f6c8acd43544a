/* SPDX-License-Identifier: MIT */
#include "libclient/look_ahead.h"

#include <errno.h>
#include <math.h>
#include <pthread.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "libclient/select/motion.h"

/*
 * Cameras that are looked at, as shares of the horizon: close together where they will come true
 * first, and are most likely to.
 */
static const double looks[] = { 0.05, 0.12, 0.22, 0.36, 0.55, 0.77, 1.0 };

#define LOOK_COUNT ARRAY_LENGTH(looks)
/* A power of two, and twice as many as there can be nodes: slots are found at once. */
#define SEEN_SLOT_COUNT 16384u

static_assert(SEEN_SLOT_COUNT >= 2 * LOOK_AHEAD_WANT_COUNT_MAX, "the table stays half empty");

/* A list, whole: written by the thread, then the owner's. */
struct list_ahead {
	struct ooc_want *wants; /* LOOK_AHEAD_WANT_COUNT_MAX, nearest in time first */
	size_t count;
	size_t ends[LOOK_COUNT]; /* how many lie before the end of each look */
};

/* A node that is in the list under construction; of an older list, if the serial is another. */
struct seen {
	const struct ooc_store *store;
	uint32_t node;
	uint32_t serial;
};

struct look_ahead {
	struct look_ahead_config config;
	pthread_t thread;
	pthread_mutex_t mutex;
	pthread_cond_t woken;

	/* Under the mutex. */
	struct motion motion;
	bool is_new; /* a camera has come that no list was made for */
	bool is_over;
	struct list_ahead ready; /* the newest list that is whole */

	/* The thread's. */
	struct list_ahead making;
	struct ooc_want *chosen;
	struct seen *seen;
	uint32_t serial;

	/* The owner's. */
	struct ooc_want *sent;
	size_t sent_count;
};

/* ---- the thread ---- */

/* Was the node put into this list already?  Now it is. */
static bool see_node(struct look_ahead *look_ahead, const struct ooc_want *want)
{
	uint64_t hash =
		((uint64_t)(uintptr_t)want->store + want->node) * UINT64_C(0x9e3779b97f4a7c15);
	uint32_t slot = (uint32_t)(hash >> 40) % SEEN_SLOT_COUNT;

	for (;; slot = (slot + 1) % SEEN_SLOT_COUNT) {
		struct seen *seen = &look_ahead->seen[slot];

		if (seen->serial != look_ahead->serial) {
			*seen = (struct seen){ want->store, want->node, look_ahead->serial };
			return false;
		}
		if (seen->store == want->store && seen->node == want->node)
			return true;
	}
}

static void add_look(struct look_ahead *look_ahead, const struct camera *camera, size_t look)
{
	struct list_ahead *list = &look_ahead->making;
	size_t count = look_ahead->config.choose(look_ahead->config.choose_arg, camera,
						 look_ahead->chosen);

	for (size_t i = 0; i < count && list->count < LOOK_AHEAD_WANT_COUNT_MAX; i++)
		if (!see_node(look_ahead, &look_ahead->chosen[i]))
			list->wants[list->count++] = look_ahead->chosen[i];
	list->ends[look] = list->count;
}

/* The camera of the path at a time: the last one that is not later. */
static const struct camera *path_at(const struct look_ahead_config *config, double time_s)
{
	size_t low = 0;
	size_t high = config->path_count;

	while (high - low > 1) {
		size_t middle = low + (high - low) / 2;

		if (config->path[middle].time_s <= time_s)
			low = middle;
		else
			high = middle;
	}
	return &config->path[low];
}

static void make_list(struct look_ahead *look_ahead, const struct motion *motion)
{
	const struct look_ahead_config *config = &look_ahead->config;

	look_ahead->making.count = 0;
	look_ahead->serial++;
	for (size_t i = 0; i < LOOK_COUNT; i++) {
		struct camera camera;

		if (motion_predict(motion, looks[i] * config->horizon_s, &camera) < 0)
			return;
		if (config->path_count > 0)
			camera = *path_at(config, camera.time_s);
		add_look(look_ahead, &camera, i);
	}
}

static void *run(void *arg)
{
	struct look_ahead *look_ahead = arg;

	(void)pthread_mutex_lock(&look_ahead->mutex);
	for (;;) {
		struct motion motion;
		struct list_ahead swap;

		while (!look_ahead->is_new && !look_ahead->is_over)
			(void)pthread_cond_wait(&look_ahead->woken, &look_ahead->mutex);
		if (look_ahead->is_over)
			break;
		motion = look_ahead->motion;
		look_ahead->is_new = false;
		(void)pthread_mutex_unlock(&look_ahead->mutex);

		make_list(look_ahead, &motion);

		(void)pthread_mutex_lock(&look_ahead->mutex);
		swap = look_ahead->ready;
		look_ahead->ready = look_ahead->making;
		look_ahead->making = swap;
	}
	(void)pthread_mutex_unlock(&look_ahead->mutex);
	return NULL;
}

/* ---- the owner ---- */

static void look_ahead_free(struct look_ahead *look_ahead)
{
	free(look_ahead->ready.wants);
	free(look_ahead->making.wants);
	free(look_ahead->chosen);
	free(look_ahead->seen);
	free(look_ahead->sent);
	free(look_ahead);
}

int look_ahead_create(const struct look_ahead_config *config, struct look_ahead **ret)
{
	struct look_ahead *look_ahead = calloc(1, sizeof(*look_ahead));
	int r;

	CHECK(config->horizon_s > 0.0);
	if (!look_ahead)
		return -ENOMEM;
	look_ahead->config = *config;
	motion_init(&look_ahead->motion);
	look_ahead->ready.wants = calloc(LOOK_AHEAD_WANT_COUNT_MAX, sizeof(struct ooc_want));
	look_ahead->making.wants = calloc(LOOK_AHEAD_WANT_COUNT_MAX, sizeof(struct ooc_want));
	look_ahead->chosen = calloc(LOOK_AHEAD_WANT_COUNT_MAX, sizeof(struct ooc_want));
	look_ahead->sent = calloc(LOOK_AHEAD_WANT_COUNT_MAX, sizeof(struct ooc_want));
	look_ahead->seen = calloc(SEEN_SLOT_COUNT, sizeof(*look_ahead->seen));
	if (!look_ahead->ready.wants || !look_ahead->making.wants || !look_ahead->chosen ||
	    !look_ahead->sent || !look_ahead->seen) {
		look_ahead_free(look_ahead);
		return -ENOMEM;
	}
	(void)pthread_mutex_init(&look_ahead->mutex, NULL);
	(void)pthread_cond_init(&look_ahead->woken, NULL);
	r = -pthread_create(&look_ahead->thread, NULL, run, look_ahead);
	if (r < 0) {
		(void)pthread_cond_destroy(&look_ahead->woken);
		(void)pthread_mutex_destroy(&look_ahead->mutex);
		look_ahead_free(look_ahead);
		return r;
	}
	*ret = look_ahead;
	return 0;
}

struct look_ahead *look_ahead_destroy(struct look_ahead *look_ahead)
{
	if (!look_ahead)
		return NULL;
	(void)pthread_mutex_lock(&look_ahead->mutex);
	look_ahead->is_over = true;
	(void)pthread_cond_signal(&look_ahead->woken);
	(void)pthread_mutex_unlock(&look_ahead->mutex);
	(void)pthread_join(look_ahead->thread, NULL);
	(void)pthread_cond_destroy(&look_ahead->woken);
	(void)pthread_mutex_destroy(&look_ahead->mutex);
	look_ahead_free(look_ahead);
	return NULL;
}

void look_ahead_see(struct look_ahead *look_ahead, const struct camera *camera)
{
	(void)pthread_mutex_lock(&look_ahead->mutex);
	motion_note(&look_ahead->motion, camera);
	look_ahead->is_new = true;
	(void)pthread_cond_signal(&look_ahead->woken);
	(void)pthread_mutex_unlock(&look_ahead->mutex);
}

/* The nodes of a list that have to be read, as many as the budget carries.  Returns: how many. */
static size_t take(struct look_ahead *look_ahead, const struct look_ahead_budget *budget,
		   struct look_ahead_report *ret)
{
	const struct list_ahead *list = &look_ahead->ready;
	size_t count = 0;
	size_t at = 0;

	while (at < list->count) {
		const struct ooc_want *want = &list->wants[at];
		uint64_t bytes = ooc_nodes(want->store)[want->node].stored_bytes;

		if (ooc_node_state(want->store, want->node) == OOC_STATE_ABSENT) {
			if (count == budget->requests || ret->bytes + bytes > budget->bytes)
				break;
			look_ahead->sent[count] = *want;
			/* The order is the list's own; the protocol wants it to descend. */
			look_ahead->sent[count].importance =
				(float)(LOOK_AHEAD_WANT_COUNT_MAX - count);
			ret->bytes += bytes;
			count++;
		}
		at++;
	}
	for (size_t i = 0; i < LOOK_COUNT && list->count > 0 && list->ends[i] <= at; i++)
		ret->reach_s = looks[i] * look_ahead->config.horizon_s;
	return count;
}

int look_ahead_send(struct look_ahead *look_ahead, struct ooc_client *client,
		    const struct look_ahead_budget *budget, struct look_ahead_report *ret)
{
	size_t count;

	*ret = (struct look_ahead_report){ .requests = 0 };
	(void)pthread_mutex_lock(&look_ahead->mutex);
	count = take(look_ahead, budget, ret);
	(void)pthread_mutex_unlock(&look_ahead->mutex);
	ret->requests = (uint32_t)count;
	ret->wants = look_ahead->sent;
	/* Nothing once more: there is nothing to replace. */
	if (count == 0 && look_ahead->sent_count == 0)
		return 0;
	look_ahead->sent_count = count;
	return ooc_prefetch(client, look_ahead->sent, count);
}

size_t look_ahead_expected(struct look_ahead *look_ahead, struct ooc_want *ret)
{
	size_t count;

	(void)pthread_mutex_lock(&look_ahead->mutex);
	count = look_ahead->ready.count;
	memcpy(ret, look_ahead->ready.wants, count * sizeof(*ret));
	(void)pthread_mutex_unlock(&look_ahead->mutex);
	return count;
}
