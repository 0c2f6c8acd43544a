/* SPDX-License-Identifier: MIT */
#include "tools/bench/accuracy/tour.h"

#include <errno.h>
#include <math.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <xxhash.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "formats/base/clock.h"
#include "libclient/look_ahead.h"
#include "libclient/ooc/client.h"
#include "libclient/select/raster.h"
#include "tools/bench/base/measure.h"

#define WAIT_MS_MAX 600000
#define NEVER       UINT32_MAX
/* Of the model's diagonal: how far the rival looks that asks for all that is near. */
#define RADIUS_SHARE 0.15

/* What has happened to a node. */
struct visit {
	uint32_t wanted_first; /* frame; NEVER */
	uint32_t drawn_first;
	uint32_t asked_first; /* ahead of time */
	uint32_t came;        /* seen to be there, asked for and not wanted yet */
	double wanted_ms;
	uint32_t set_frame; /* newest frame whose set has it */
};

struct traveller {
	const struct tour_options *options;
	struct tour *tour;
	struct ooc_client *client;
	struct ooc_store *store;
	const struct store_superblock *superblock;
	const struct store_node *nodes;
	uint64_t node_count;
	double aspect;
	struct selector *selector;
	struct selector *selector_ahead; /* the look-ahead thread's */
	struct look_ahead *look_ahead;
	struct raster *raster;
	struct visit *visits;
	struct ooc_want *wants;
	bool *drawn; /* a want */
	size_t want_count;
	uint32_t *expected; /* asked for, and neither come nor wanted */
	size_t expected_count;
	size_t missing_room;
	struct camera *cameras; /* of the path, at this tour's times */
	uint64_t begin_ns;
	uint64_t next_ns;
	struct ooc_counters counters;
};

const char *tour_ahead_name(enum tour_ahead ahead)
{
	static const char *const names[TOUR_AHEAD_COUNT_] = {
		[TOUR_AHEAD_NOTHING] = "nothing", [TOUR_AHEAD_SELECTION] = "selection",
		[TOUR_AHEAD_PATH] = "path",       [TOUR_AHEAD_FRUSTUM] = "frustum",
		[TOUR_AHEAD_RADIUS] = "radius",
	};

	return names[ahead];
}

/* ---- the choice of nodes ---- */

static int view_make(const struct traveller *traveller, const struct camera *camera,
		     struct camera_view *ret)
{
	return camera_view_init(ret, camera, traveller->superblock, traveller->aspect,
				camera_near(camera, traveller->superblock));
}

static void choose(struct selector *selector, const struct camera_view *view,
		   const struct select_options *options, struct selection *ret)
{
	if (options->budget_triangles == 0)
		select_frustum(selector, view, ret);
	else
		select_approximate(selector, view, options, ret);
}

static size_t wants_of(const struct traveller *traveller, const struct selection *selection,
		       size_t count_max, struct ooc_want *ret)
{
	size_t count = selection->entry_count < count_max ? selection->entry_count : count_max;

	for (size_t i = 0; i < count; i++)
		ret[i] = (struct ooc_want){ traveller->store, selection->entries[i].node,
					    selection->entries[i].importance };
	return count;
}

/* On the look-ahead's thread: reads what does not change during a tour, and its own selector. */
static size_t choose_ahead(void *arg, const struct camera *camera, struct ooc_want *ret)
{
	const struct traveller *traveller = arg;
	const struct tour_options *options = traveller->options;
	struct selection selection;
	struct camera_view view;

	if (view_make(traveller, camera, &view) < 0)
		return 0;
	if (options->ahead == TOUR_AHEAD_FRUSTUM)
		select_frustum(traveller->selector_ahead, &view, &selection);
	else
		choose(traveller->selector_ahead, &view, &options->selection, &selection);
	return wants_of(traveller, &selection, LOOK_AHEAD_WANT_COUNT_MAX, ret);
}

struct near_node {
	double distance2;
	uint32_t node;
};

static int compare_near(const void *left, const void *right)
{
	const struct near_node *a = left;
	const struct near_node *b = right;

	if (a->distance2 != b->distance2)
		return a->distance2 < b->distance2 ? -1 : 1;
	return a->node < b->node ? -1 : a->node > b->node;
}

static double distance2_of(const struct traveller *traveller, uint32_t node,
			   const struct camera *camera)
{
	double distance2 = 0.0;

	for (unsigned k = 0; k < 3; k++) {
		double eye = camera->eye[k] - traveller->superblock->origin[k];
		double off = fmax(0.0, fmax(traveller->nodes[node].box_min[k] - eye,
					    eye - traveller->nodes[node].box_max[k]));

		distance2 += off * off;
	}
	return distance2;
}

/* All that is near, whichever way one looks: what stands for visibility from a region. */
static size_t choose_near(void *arg, const struct camera *camera, struct ooc_want *ret)
{
	const struct traveller *traveller = arg;
	struct near_node *near = calloc(traveller->node_count, sizeof(*near));
	double radius = 0.0;
	size_t count = 0;

	if (!near)
		return 0;
	for (unsigned k = 0; k < 3; k++)
		radius = hypot(radius, traveller->superblock->box_max[k] -
					       traveller->superblock->box_min[k]);
	radius *= RADIUS_SHARE;
	for (uint32_t i = 0; i < traveller->node_count; i++) {
		double distance2 = distance2_of(traveller, i, camera);

		if (traveller->nodes[i].payload_id != 0 && distance2 <= radius * radius)
			near[count++] = (struct near_node){ distance2, i };
	}
	qsort(near, count, sizeof(*near), compare_near);
	if (count > LOOK_AHEAD_WANT_COUNT_MAX)
		count = LOOK_AHEAD_WANT_COUNT_MAX;
	for (size_t i = 0; i < count; i++)
		ret[i] = (struct ooc_want){ traveller->store, near[i].node, 0.0f };
	free(near);
	return count;
}

/* ---- what becomes of nodes ---- */

/* Before they are asked for: what comes while a set is sent was not there before. */
static void note_wanted(struct traveller *traveller, uint32_t frame)
{
	struct tour *tour = traveller->tour;

	for (size_t i = 0; i < traveller->want_count; i++) {
		uint32_t node = traveller->wants[i].node;
		struct visit *visit = &traveller->visits[node];

		visit->set_frame = frame;
		if (visit->wanted_first != NEVER)
			continue;
		visit->wanted_first = frame;
		visit->wanted_ms = (double)(clock_now_ns() - traveller->begin_ns) * 1e-6;
		if (frame <= tour->begun) {
			visit->came = NEVER;
			continue;
		}
		tour->firsts.count++;
		if (ooc_node_state(traveller->store, node) != OOC_STATE_READY)
			continue;
		tour->firsts.ready_count++;
		if (visit->came == NEVER)
			continue;
		tour->firsts.leads_frames[tour->firsts.lead_count++] = frame - visit->came;
		if (frame - visit->came > TOUR_USED_FRAMES)
			continue;
		tour->prefetches.used_count++;
		tour->prefetches.used_bytes += traveller->nodes[node].stored_bytes;
	}
}

static void note_drawn(struct traveller *traveller, size_t want, uint32_t frame)
{
	struct visit *visit = &traveller->visits[traveller->wants[want].node];
	struct tour_firsts *firsts = &traveller->tour->firsts;

	traveller->drawn[want] = true;
	if (visit->drawn_first != NEVER)
		return;
	visit->drawn_first = frame;
	if (visit->wanted_first <= traveller->tour->begun)
		return;
	firsts->waits_frames[firsts->drawn_count] = frame - visit->wanted_first;
	firsts->waits_ms[firsts->drawn_count] =
		(double)(clock_now_ns() - traveller->begin_ns) * 1e-6 - visit->wanted_ms;
	firsts->drawn_count++;
}

static void note_asked(struct traveller *traveller, const struct look_ahead_report *report,
		       uint32_t frame)
{
	for (uint32_t i = 0; i < report->requests; i++) {
		uint32_t node = report->wants[i].node;
		struct visit *visit = &traveller->visits[node];

		if (visit->asked_first != NEVER || visit->wanted_first != NEVER)
			continue;
		visit->asked_first = frame;
		traveller->expected[traveller->expected_count++] = node;
		traveller->tour->prefetches.asked_count++;
	}
}

/* Of what was asked for: what is there now, before anybody wants it. */
static void note_come(struct traveller *traveller, uint32_t frame)
{
	size_t kept = 0;

	for (size_t i = 0; i < traveller->expected_count; i++) {
		uint32_t node = traveller->expected[i];
		struct visit *visit = &traveller->visits[node];

		if (visit->wanted_first != NEVER)
			continue;
		if (ooc_node_state(traveller->store, node) != OOC_STATE_READY) {
			traveller->expected[kept++] = node;
			continue;
		}
		visit->came = frame;
	}
	traveller->expected_count = kept;
}

/* At the end: what came of all that was asked for. */
static void count_come(struct traveller *traveller)
{
	struct tour_prefetches *prefetches = &traveller->tour->prefetches;

	for (size_t i = 0; i < traveller->node_count; i++) {
		if (traveller->visits[i].came == NEVER)
			continue;
		prefetches->came_count++;
		prefetches->came_bytes += traveller->nodes[i].stored_bytes;
	}
}

/* ---- a frame ---- */

/* Draws what is there and not drawn yet.  Returns: how many are left, or -ENOMEM. */
static int64_t draw_ready(struct traveller *traveller, const struct camera_view *view,
			  uint32_t frame, struct tour_frame *ret)
{
	int64_t left = 0;

	for (size_t i = 0; i < traveller->want_count; i++) {
		uint32_t node = traveller->wants[i].node;
		const void *payload;

		if (traveller->drawn[i])
			continue;
		payload = ooc_map(traveller->store, node);
		if (!payload) {
			left += ooc_not_now(traveller->store, node) == OOC_REASON_NONE;
			continue;
		}
		if (raster_draw_payload(traveller->raster, view, payload, (uint64_t)node << 32, 1) <
		    0)
			return -ENOMEM;
		ret->triangles += traveller->nodes[node].triangle_count;
		note_drawn(traveller, i, frame);
	}
	return left;
}

/* Until something has come.  Returns: milliseconds that passed. */
static double wait_for_more(struct traveller *traveller)
{
	uint64_t begin_ns = clock_now_ns();
	struct pollfd fd = { .fd = ooc_fd(traveller->client), .events = POLLIN };

	(void)poll(&fd, 1, 100);
	(void)ooc_dispatch(traveller->client);
	return (double)(clock_now_ns() - begin_ns) * 1e-6;
}

static int draw_waiting(struct traveller *traveller, const struct camera_view *view, uint32_t frame,
			struct tour_frame *ret, struct why *why)
{
	uint64_t deadline_ns = clock_now_ns() + WAIT_MS_MAX * NS_PER_MS;
	uint64_t begin_ns = clock_now_ns();
	int64_t left;

	if (traveller->options->fetching == TOUR_SEQUENTIAL) {
		int r = ooc_wait(traveller->client, WAIT_MS_MAX);

		if (r < 0)
			return why_set(why, r, "waiting for a frame's nodes: %s",
				       ooc_error_text(traveller->client));
		ret->wait_ms = (double)(clock_now_ns() - begin_ns) * 1e-6;
	}
	while ((left = draw_ready(traveller, view, frame, ret)) > 0) {
		if (measure_was_cancelled())
			return why_set(why, -ECANCELED, "interrupted");
		if (clock_now_ns() > deadline_ns)
			return why_set(why, -ETIMEDOUT, "%lld nodes do not come", (long long)left);
		ret->wait_ms += wait_for_more(traveller);
	}
	return (int)left;
}

static int note_missing(struct traveller *traveller, struct tour_frame *ret)
{
	struct tour *tour = traveller->tour;

	ret->missing_first = tour->missing_count;
	if (tour->missing_count + traveller->want_count > traveller->missing_room) {
		size_t room = 2 * traveller->missing_room + traveller->want_count;
		uint32_t *missing = realloc(tour->missing, room * sizeof(*missing));

		if (!missing)
			return -ENOMEM;
		tour->missing = missing;
		traveller->missing_room = room;
	}
	for (size_t i = 0; i < traveller->want_count; i++)
		if (!traveller->drawn[i])
			tour->missing[tour->missing_count++] = traveller->wants[i].node;
	ret->missing = (uint32_t)(tour->missing_count - ret->missing_first);
	return 0;
}

/* A frame begins a frame's time after the one before, or at once when that took longer. */
static void pace(struct traveller *traveller)
{
	uint64_t frame_ns = (uint64_t)(traveller->options->frame_s * (double)NS_PER_S);
	uint64_t now_ns = clock_now_ns();

	if (traveller->next_ns > now_ns) {
		struct timespec until = { .tv_sec = (time_t)(traveller->next_ns / NS_PER_S),
					  .tv_nsec = (long)(traveller->next_ns % NS_PER_S) };

		(void)clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, NULL);
		now_ns = clock_now_ns();
	}
	traveller->next_ns = now_ns + frame_ns;
}

static void note_bytes(struct traveller *traveller, struct tour_frame *ret)
{
	struct ooc_counters counters;

	ooc_counters(traveller->client, &counters);
	ret->fetched_bytes = counters.fetched_bytes - traveller->counters.fetched_bytes;
	ret->ahead_bytes = counters.prefetched_bytes - traveller->counters.prefetched_bytes;
	traveller->counters = counters;
}

static int ask(struct traveller *traveller, const struct camera *camera, uint32_t frame,
	       struct camera_view *ret_view, struct tour_frame *ret, struct why *why)
{
	struct selection selection;
	int64_t serial;
	int r = view_make(traveller, camera, ret_view);

	if (r < 0)
		return why_set(why, r, "a camera of the path looks nowhere");
	choose(traveller->selector, ret_view, &traveller->options->selection, &selection);
	traveller->want_count =
		wants_of(traveller, &selection, traveller->node_count, traveller->wants);
	memset(traveller->drawn, 0, traveller->want_count * sizeof(*traveller->drawn));
	ret->wanted = (uint32_t)traveller->want_count;
	for (size_t i = 0; i < traveller->want_count; i++)
		ret->set_bytes += traveller->nodes[traveller->wants[i].node].payload_bytes;
	(void)ooc_dispatch(traveller->client);
	note_wanted(traveller, frame);
	serial = ooc_visible_set(traveller->client, traveller->wants, traveller->want_count);
	return serial < 0 ? why_set(why, (int)serial, "asking for a frame's nodes: %s",
				    ooc_error_text(traveller->client))
			  : 0;
}

static void look_ahead(struct traveller *traveller, uint32_t frame)
{
	const struct look_ahead_budget budget = { traveller->options->ahead_bytes,
						  traveller->options->ahead_requests };
	struct look_ahead_report report;

	if (!traveller->look_ahead)
		return;
	(void)look_ahead_send(traveller->look_ahead, traveller->client, &budget, &report);
	note_asked(traveller, &report, frame);
	note_come(traveller, frame);
}

static int frame_run(struct traveller *traveller, uint32_t frame, struct why *why)
{
	const struct tour_options *options = traveller->options;
	const struct camera *camera = &traveller->cameras[frame];
	struct tour_frame *ret = &traveller->tour->frames[frame];
	struct camera_view view;
	uint64_t begin_ns;
	int r;

	pace(traveller);
	note_come(traveller, frame);
	begin_ns = clock_now_ns();
	raster_clear(traveller->raster);
	if (traveller->look_ahead)
		look_ahead_see(traveller->look_ahead, camera);
	r = ask(traveller, camera, frame, &view, ret, why);
	if (r < 0)
		return r;
	if (options->waits)
		r = draw_waiting(traveller, &view, frame, ret, why);
	else if (draw_ready(traveller, &view, frame, ret) < 0)
		r = why_set(why, -ENOMEM, "out of memory");
	if (r == 0 && note_missing(traveller, ret) < 0)
		r = why_set(why, -ENOMEM, "out of memory");
	if (r < 0)
		return r;
	if (ret->missing == 0 && traveller->tour->begun > frame)
		traveller->tour->begun = frame;
	ret->ms = (double)(clock_now_ns() - begin_ns) * 1e-6;
	look_ahead(traveller, frame);
	note_bytes(traveller, ret);
	ret->picture = XXH3_64bits(raster_items(traveller->raster),
				   (size_t)options->width * options->height * sizeof(uint64_t));
	return measure_was_cancelled() ? why_set(why, -ECANCELED, "interrupted") : 0;
}

/* ---- a tour ---- */

static int connect_and_open(struct traveller *traveller, struct why *why)
{
	const struct tour_options *options = traveller->options;
	int r = ooc_connect(options->socket_path, "oocbench walk", &traveller->client);

	if (r < 0)
		return why_set(why, r, "the daemon cannot be reached: %s", ooc_error_text(NULL));
	r = ooc_open(traveller->client, options->store, &traveller->store);
	if (r < 0)
		return why_set(why, r, "%s: %s", options->store, ooc_error_text(traveller->client));
	traveller->superblock = ooc_superblock(traveller->store);
	traveller->nodes = ooc_nodes(traveller->store);
	traveller->node_count = ooc_node_count(traveller->store);
	traveller->aspect = (double)options->width / options->height;
	return 0;
}

static int tables_make(struct traveller *traveller)
{
	struct tour *tour = traveller->tour;
	const struct tour_options *options = traveller->options;
	size_t count = traveller->node_count + 1;

	traveller->cameras = calloc(options->camera_count, sizeof(*traveller->cameras));
	tour->frames = calloc(options->camera_count, sizeof(*tour->frames));
	tour->firsts.waits_frames = calloc(count, sizeof(double));
	tour->firsts.waits_ms = calloc(count, sizeof(double));
	tour->firsts.leads_frames = calloc(count, sizeof(double));
	traveller->visits = calloc(count, sizeof(*traveller->visits));
	traveller->wants = calloc(count, sizeof(*traveller->wants));
	traveller->drawn = calloc(count, sizeof(*traveller->drawn));
	traveller->expected = calloc(count, sizeof(*traveller->expected));
	if (!traveller->cameras || !tour->frames || !tour->firsts.waits_frames ||
	    !tour->firsts.waits_ms || !tour->firsts.leads_frames || !traveller->visits ||
	    !traveller->wants || !traveller->drawn || !traveller->expected)
		return -ENOMEM;
	for (size_t i = 0; i < traveller->node_count; i++)
		traveller->visits[i] = (struct visit){ .wanted_first = NEVER,
						       .drawn_first = NEVER,
						       .asked_first = NEVER,
						       .came = NEVER };
	for (size_t i = 0; i < options->camera_count; i++) {
		traveller->cameras[i] = options->cameras[i];
		/* The walker is as fast as the frames are. */
		if (options->frame_s > 0.0)
			traveller->cameras[i].time_s = (double)i * options->frame_s;
	}
	return 0;
}

static int look_ahead_start(struct traveller *traveller)
{
	const struct tour_options *options = traveller->options;
	struct look_ahead_config config = {
		.choose = options->ahead == TOUR_AHEAD_RADIUS ? choose_near : choose_ahead,
		.choose_arg = traveller,
		.horizon_s = options->horizon_s,
	};

	if (options->ahead == TOUR_AHEAD_NOTHING)
		return 0;
	if (options->ahead == TOUR_AHEAD_PATH) {
		config.path = traveller->cameras;
		config.path_count = options->camera_count;
	}
	return look_ahead_create(&config, &traveller->look_ahead);
}

static int traveller_init(struct traveller *traveller, struct why *why)
{
	const struct tour_options *options = traveller->options;
	int r = connect_and_open(traveller, why);

	if (r < 0)
		return r;
	if (tables_make(traveller) < 0 ||
	    selector_create(traveller->superblock, traveller->nodes, &traveller->selector) < 0 ||
	    selector_create(traveller->superblock, traveller->nodes, &traveller->selector_ahead) <
		    0 ||
	    raster_create(options->width, options->height, &traveller->raster) < 0 ||
	    look_ahead_start(traveller) < 0)
		return why_set(why, -ENOMEM, "out of memory");
	/* Only who waits has a use for being told. */
	ooc_notify(traveller->client, options->waits);
	ooc_counters(traveller->client, &traveller->counters);
	return 0;
}

static void traveller_done(struct traveller *traveller)
{
	traveller->look_ahead = look_ahead_destroy(traveller->look_ahead);
	selector_destroy(traveller->selector);
	selector_destroy(traveller->selector_ahead);
	raster_destroy(traveller->raster);
	free(traveller->cameras);
	free(traveller->visits);
	free(traveller->wants);
	free(traveller->drawn);
	free(traveller->expected);
	ooc_disconnect(traveller->client);
}

int tour_run(const struct tour_options *options, struct tour *ret, struct why *why)
{
	struct tour tour = { .frame_count = options->camera_count, .begun = options->camera_count };
	struct traveller traveller = { .options = options, .tour = &tour };
	int r = traveller_init(&traveller, why);

	traveller.begin_ns = clock_now_ns();
	for (size_t i = 0; r == 0 && i < options->camera_count; i++) {
		r = frame_run(&traveller, (uint32_t)i, why);
		if (r < 0)
			break;
		tour.fetched_bytes += tour.frames[i].fetched_bytes;
		tour.ahead_bytes += tour.frames[i].ahead_bytes;
	}
	if (r == 0)
		count_come(&traveller);
	tour.seconds = (double)(clock_now_ns() - traveller.begin_ns) * 1e-9;
	traveller_done(&traveller);
	if (r < 0) {
		tour_done(&tour);
		return r;
	}
	*ret = tour;
	return 0;
}

void tour_done(struct tour *tour)
{
	free(tour->frames);
	free(tour->missing);
	free(tour->firsts.waits_frames);
	free(tour->firsts.waits_ms);
	free(tour->firsts.leads_frames);
	*tour = (struct tour){ .frames = NULL };
}

int tour_warm(const struct tour_options *options, struct why *why)
{
	struct traveller traveller = { .options = options };
	struct ooc_want *wants = NULL;
	size_t count = 0;
	int r = connect_and_open(&traveller, why);

	if (r == 0) {
		wants = calloc(traveller.node_count + 1, sizeof(*wants));
		if (!wants)
			r = why_set(why, -ENOMEM, "out of memory");
	}
	for (uint32_t i = 0; r == 0 && i < traveller.node_count; i++)
		if (traveller.nodes[i].payload_id != 0)
			wants[count++] = (struct ooc_want){ traveller.store, i, 1.0f };
	if (r == 0 && (ooc_visible_set(traveller.client, wants, count) < 0 ||
		       ooc_wait(traveller.client, WAIT_MS_MAX) < 0))
		r = why_set(why, -EIO, "the store cannot be made resident: %s",
			    ooc_error_text(traveller.client));
	free(wants);
	ooc_disconnect(traveller.client);
	return r;
}
