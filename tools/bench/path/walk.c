/* SPDX-License-Identifier: MIT */
#include "tools/bench/path/walk.h"

#include <errno.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/random.h"
#include "tools/bench/base/measure.h"

/* A person in a storey of 3.8 m, free height: shares of the storey. */
#define STOREY_METRES 3.8
#define EYE_SHARE     0.42 /* 1.6 m */
#define HEAD_SHARE    0.46 /* 1.75 m */
#define KNEE_SHARE    0.15 /* what is lower is stepped over */
#define RADIUS_SHARE  0.05 /* 19 cm: through a door that is not quite open */
#define STEP_SHARE    0.07 /* 25 cm up or down from one voxel to the next */
/** A person fits where storeys are within these. */
#define PERSON_STOREY_MIN_METRES 2.1
#define PERSON_STOREY_MAX_METRES 40.0
/** Voxels of the fine grid to a storey: a door is nine of them wide. */
#define STOREY_VOXELS 40.0
/** Storeys a second at 30 points a second: a brisk walk through a building. */
#define SPACING_SHARE 0.02

/** The smallest room worth a walk, in squares of a storey's height. */
#define ROOM_STOREYS2 0.5

/** Stands that are compared for what there is to see from them. */
#define DETAIL_CHOICES    12
#define GOAL_CANDIDATES   24
#define ROOFED_TRIES      64
#define UNROOFED_COST     3.0f /* the walk is meant for the inside */
#define EDGE_COST         2.0f /* and for the middle of the way */
#define SMOOTHING_ROUNDS  80
#define SMOOTHING_SHRINKS 0.8 /* a smooth way is at least this share of the first one's length */

struct walker {
	double storey, eye, head, knee, radius; /* voxels */
	uint32_t step;
};

/** Somewhere to stand. */
struct stand {
	uint32_t x, y, z; /* of the eye */
	uint32_t component;
	float edge_steps; /* how far from where one cannot stand */
	bool is_roofed;
};

struct ground {
	const struct occupancy *occupancy;
	struct walker walker;
	struct stand *stands; /* column by column */
	uint32_t stand_count;
	uint32_t *first_of_column; /* columns and one */
	uint32_t component;        /* the one to walk in */
	bool has_roof;             /* most of it is under something */
	struct random random;
};

/* ---- the walker's size ---- */

/*
 * Height that half of the room has, by volume: of the free runs of all columns that stand on
 * something and, if is_roofed, end below something.  0 when there is none.
 */
static double storey_find(const struct occupancy *occupancy, bool is_roofed)
{
	uint32_t height = occupancy->size[2];
	uint64_t *volumes = calloc(height + 1, sizeof(*volumes));
	uint64_t total = 0;
	uint64_t sum = 0;
	uint32_t length = 0;

	if (!volumes)
		return 0.0;
	for (size_t column = 0; column < (size_t)occupancy->size[0] * occupancy->size[1];
	     column++) {
		const uint8_t *full = &occupancy->full[column * height];
		uint32_t run = 0;
		bool stands = false;

		for (uint32_t z = 0; z < height; z++) {
			if (!full[z]) {
				run++;
				continue;
			}
			if (stands)
				volumes[run] += run;
			stands = true;
			run = 0;
		}
		if (stands && !is_roofed)
			volumes[run] += run;
	}
	for (uint32_t i = 3; i <= height; i++)
		total += volumes[i];
	for (uint32_t i = 3; i <= height && 2 * sum < total; i++) {
		sum += volumes[i];
		length = i;
	}
	free(volumes);
	return length;
}

/* ---- the survey ---- */

/** Volume of the rooms, slice by slice along each axis. */
struct rooms {
	double *slices[3];
	double total;
};

/* Rooms are free runs between a floor and a ceiling whose height is about a storey. */
static int rooms_measure(const struct occupancy *occupancy, double storey, bool is_roofed,
			 struct rooms *ret)
{
	uint32_t height = occupancy->size[2];
	struct rooms rooms = { .total = 0.0 };

	for (unsigned i = 0; i < 3; i++)
		rooms.slices[i] = calloc(occupancy->size[i], sizeof(double));
	*ret = rooms;
	if (!rooms.slices[0] || !rooms.slices[1] || !rooms.slices[2])
		return -ENOMEM;
	for (size_t column = 0; column < (size_t)occupancy->size[0] * occupancy->size[1];
	     column++) {
		const uint8_t *full = &occupancy->full[column * height];
		uint32_t begin = 0; /* of the run: above the last full voxel */

		for (uint32_t z = 0; z <= height; z++) {
			uint32_t run = z - begin;

			if (z < height && !full[z])
				continue;
			if (begin > 0 && (z < height || !is_roofed) && run >= 0.5 * storey &&
			    run <= 3.0 * storey) {
				rooms.slices[0][column % occupancy->size[0]] += run;
				rooms.slices[1][column / occupancy->size[0]] += run;
				for (uint32_t k = begin; k < z; k++)
					rooms.slices[2][k] += 1.0;
				ret->total += run;
			}
			begin = z + 1;
		}
	}
	return 0;
}

static void rooms_done(struct rooms *rooms)
{
	for (unsigned i = 0; i < 3; i++)
		free(rooms->slices[i]);
}

/* The slice below which a share of the rooms lies. */
static double rooms_quantile(const struct rooms *rooms, const struct occupancy *occupancy,
			     unsigned axis, double share)
{
	double sum = 0.0;

	for (uint32_t i = 0; i < occupancy->size[axis]; i++) {
		sum += rooms->slices[axis][i];
		if (sum >= share * rooms->total)
			return i;
	}
	return occupancy->size[axis];
}

/* The part of the model that has the rooms, as much of it as a grid of fine voxels can hold. */
static void site_choose(const struct occupancy *coarse, const struct rooms *rooms, double storey,
			uint64_t seed, struct walk_site *ret)
{
	struct random lottery = { seed };
	struct occupancy_region *region = &ret->region;
	double voxels = 1.0;

	ret->storey = storey * coarse->voxel;
	region->voxel = ret->storey / STOREY_VOXELS;
	for (unsigned i = 0; i < 3; i++) {
		double low = rooms_quantile(rooms, coarse, i, 0.005) - 0.5 * storey;
		double high = rooms_quantile(rooms, coarse, i, 0.995) + 0.5 * storey;

		region->low[i] = coarse->corner[i] + low * coarse->voxel;
		region->high[i] = coarse->corner[i] + high * coarse->voxel;
		voxels *= (region->high[i] - region->low[i]) / region->voxel + 8.0;
	}
	for (unsigned i = 0; voxels > (double)OCCUPANCY_VOXELS_MAX && i < 2; i++) {
		/* A share of the middle axis; the height is kept, for stairs. */
		double extent = region->high[i] - region->low[i];
		double kept = extent * sqrt((double)OCCUPANCY_VOXELS_MAX / voxels) * 0.98;
		double share = random_unit(&lottery);
		double middle =
			coarse->corner[i] + rooms_quantile(rooms, coarse, i, share) * coarse->voxel;
		double low =
			fmin(fmax(middle - 0.5 * kept, region->low[i]), region->high[i] - kept);

		region->low[i] = low;
		region->high[i] = low + kept;
	}
}

int walk_survey(const struct occupancy *coarse, double unit_metres, uint64_t seed,
		struct walk_site *ret, struct why *why)
{
	bool is_roofed = true;
	double storey = storey_find(coarse, true);
	struct rooms rooms;
	double metres;
	int r;

	if (storey == 0.0) {
		is_roofed = false;
		storey = storey_find(coarse, false);
	}
	if (storey == 0.0)
		return why_set(why, -ENODATA,
			       "there is no floor to walk on; --kind orbit needs none");
	r = rooms_measure(coarse, storey, is_roofed, &rooms);
	if (r < 0) {
		rooms_done(&rooms);
		return why_errno(why, r, "no walk");
	}
	metres = storey * coarse->voxel * unit_metres;
	if (metres >= PERSON_STOREY_MIN_METRES && metres <= PERSON_STOREY_MAX_METRES)
		storey *= STOREY_METRES / metres;
	site_choose(coarse, &rooms, storey, seed, ret);
	rooms_done(&rooms);
	return 0;
}

/* ---- where one can stand ---- */

/* Is anything in the walker's way with the eye at a point, from knee to head and around it? */
static bool is_free(const struct occupancy *occupancy, const struct walker *walker,
		    const double eye[3], double radius)
{
	double low = eye[2] - walker->eye + walker->knee;
	double high = eye[2] - walker->eye + walker->head;
	int64_t z0 = (int64_t)floor(low);
	int64_t z1 = (int64_t)floor(high);

	/* Around the grid is free air, but nobody is to walk there. */
	if (z0 < 0 || z1 >= occupancy->size[2])
		return false;
	for (int64_t y = (int64_t)floor(eye[1] - radius); y <= (int64_t)floor(eye[1] + radius); y++)
		for (int64_t x = (int64_t)floor(eye[0] - radius);
		     x <= (int64_t)floor(eye[0] + radius); x++) {
			double dx = (double)x + 0.5 - eye[0];
			double dy = (double)y + 0.5 - eye[1];
			const uint8_t *column;

			if (dx * dx + dy * dy > (radius + 0.5) * (radius + 0.5))
				continue;
			if (x < 0 || y < 0 || x >= occupancy->size[0] || y >= occupancy->size[1])
				return false;
			column = &occupancy->full[occupancy_index(occupancy, (uint32_t)x,
								  (uint32_t)y, (uint32_t)z0)];
			if (memchr(column, 1, (size_t)(z1 - z0 + 1)))
				return false;
		}
	return true;
}

/* Adds the stands of one column: above each floor.  Room is made by the caller. */
static void column_stand(struct ground *ground, uint32_t x, uint32_t y)
{
	const struct occupancy *occupancy = ground->occupancy;
	const struct walker *walker = &ground->walker;
	const uint8_t *full = &occupancy->full[occupancy_index(occupancy, x, y, 0)];
	uint32_t height = occupancy->size[2];

	for (uint32_t floor_z = 0; floor_z + 1 + (uint32_t)walker->head < height; floor_z++) {
		uint32_t z = floor_z + 1 + (uint32_t)walker->eye;
		double eye[3] = { x + 0.5, y + 0.5, z + 0.5 };

		/* Right above the floor all must be free; around, what is below the knee may stay. */
		if (!full[floor_z] || memchr(&full[floor_z + 1], 1, (size_t)walker->head) ||
		    !is_free(occupancy, walker, eye, walker->radius))
			continue;
		ground->stands[ground->stand_count++] = (struct stand){
			.x = x,
			.y = y,
			.z = z,
			.component = UINT32_MAX,
			.is_roofed = memchr(&full[z], 1, height - z) != NULL,
		};
	}
}

static int stands_find(struct ground *ground)
{
	const struct occupancy *occupancy = ground->occupancy;
	size_t column_count = (size_t)occupancy->size[0] * occupancy->size[1];
	size_t room = 0;

	ground->first_of_column = malloc((column_count + 1) * sizeof(*ground->first_of_column));
	if (!ground->first_of_column)
		return -ENOMEM;
	for (uint32_t y = 0; y < occupancy->size[1]; y++)
		for (uint32_t x = 0; x < occupancy->size[0]; x++) {
			ground->first_of_column[(size_t)y * occupancy->size[0] + x] =
				ground->stand_count;
			if (room < (size_t)ground->stand_count + occupancy->size[2]) {
				size_t grown_room = 2 * room + occupancy->size[2];
				struct stand *grown =
					reallocarray(ground->stands, grown_room, sizeof(*grown));

				if (!grown)
					return -ENOMEM;
				ground->stands = grown;
				room = grown_room;
			}
			column_stand(ground, x, y);
		}
	ground->first_of_column[column_count] = ground->stand_count;
	return 0;
}

/* The stand that is one step away in one of eight directions, or UINT32_MAX. */
static uint32_t stand_beside(const struct ground *ground, uint32_t index, unsigned direction)
{
	static const int8_t steps[8][2] = { { 1, 0 }, { 0, 1 },  { -1, 0 },  { 0, -1 },
					    { 1, 1 }, { -1, 1 }, { -1, -1 }, { 1, -1 } };
	const struct stand *stand = &ground->stands[index];
	int64_t x = (int64_t)stand->x + steps[direction][0];
	int64_t y = (int64_t)stand->y + steps[direction][1];
	size_t column;

	if (x < 0 || y < 0 || x >= ground->occupancy->size[0] || y >= ground->occupancy->size[1])
		return UINT32_MAX;
	column = (size_t)y * ground->occupancy->size[0] + (size_t)x;
	for (uint32_t i = ground->first_of_column[column]; i < ground->first_of_column[column + 1];
	     i++) {
		uint32_t z = ground->stands[i].z;

		if ((z > stand->z ? z - stand->z : stand->z - z) <= ground->walker.step)
			return i;
	}
	return UINT32_MAX;
}

/*
 * Labels what hangs together, and picks the component with the most room under a roof.
 *
 * Returns: 0, -ENOMEM, or -ENODATA where none is as large as a small room.
 */
static int components_find(struct ground *ground)
{
	uint32_t *queue = malloc(((size_t)ground->stand_count + 1) * sizeof(*queue));
	double room = ROOM_STOREYS2 * ground->walker.storey * ground->walker.storey;
	double best = -1.0;

	if (!queue)
		return -ENOMEM;
	for (uint32_t first = 0; first < ground->stand_count; first++) {
		uint32_t begin = 0;
		uint32_t end = 0;
		double weight = 0.0;

		if (ground->stands[first].component != UINT32_MAX)
			continue;
		ground->stands[first].component = first;
		queue[end++] = first;
		while (begin < end) {
			uint32_t index = queue[begin++];

			weight += ground->stands[index].is_roofed ? 1.0 : 1e-6;
			for (unsigned direction = 0; direction < 8; direction++) {
				uint32_t beside = stand_beside(ground, index, direction);

				if (beside == UINT32_MAX ||
				    ground->stands[beside].component != UINT32_MAX)
					continue;
				ground->stands[beside].component = first;
				queue[end++] = beside;
			}
		}
		if (weight > best && end >= room) {
			best = weight;
			ground->component = first;
			ground->has_roof = weight > 0.3 * end;
		}
	}
	free(queue);
	return best < 0.0 ? -ENODATA : 0;
}

/* How many steps each stand is from one that lacks a neighbour. */
static int edges_find(struct ground *ground)
{
	uint32_t *queue = malloc(((size_t)ground->stand_count + 1) * sizeof(*queue));
	uint32_t begin = 0;
	uint32_t end = 0;

	if (!queue)
		return -ENOMEM;
	for (uint32_t i = 0; i < ground->stand_count; i++) {
		ground->stands[i].edge_steps = -1.0f;
		for (unsigned direction = 0; direction < 8; direction++) {
			if (stand_beside(ground, i, direction) != UINT32_MAX)
				continue;
			ground->stands[i].edge_steps = 0.0f;
			queue[end++] = i;
			break;
		}
	}
	while (begin < end) {
		uint32_t index = queue[begin++];

		for (unsigned direction = 0; direction < 8; direction++) {
			uint32_t beside = stand_beside(ground, index, direction);

			if (beside == UINT32_MAX || ground->stands[beside].edge_steps >= 0.0f)
				continue;
			ground->stands[beside].edge_steps = ground->stands[index].edge_steps + 1.0f;
			queue[end++] = beside;
		}
	}
	free(queue);
	return 0;
}

/* ---- shortest ways ---- */

struct heap_entry {
	float cost;
	uint32_t stand;
};

struct search {
	float *costs;        /* a stand; INFINITY: not reached */
	uint32_t *came_from; /* a stand */
	struct heap_entry *heap;
	size_t heap_count;
	size_t heap_room;
};

static bool entry_before(struct heap_entry a, struct heap_entry b)
{
	return a.cost < b.cost || (a.cost == b.cost && a.stand < b.stand);
}

static int heap_push(struct search *search, struct heap_entry entry)
{
	size_t at = search->heap_count++;

	if (search->heap_count > search->heap_room) {
		size_t room = 2 * search->heap_room + 1024;
		struct heap_entry *grown = reallocarray(search->heap, room, sizeof(*grown));

		if (!grown)
			return -ENOMEM;
		search->heap = grown;
		search->heap_room = room;
	}
	while (at > 0 && entry_before(entry, search->heap[(at - 1) / 2])) {
		search->heap[at] = search->heap[(at - 1) / 2];
		at = (at - 1) / 2;
	}
	search->heap[at] = entry;
	return 0;
}

static struct heap_entry heap_pop(struct search *search)
{
	struct heap_entry top = search->heap[0];
	struct heap_entry last = search->heap[--search->heap_count];
	size_t at = 0;

	for (size_t child = 1; child < search->heap_count; child = 2 * at + 1) {
		if (child + 1 < search->heap_count &&
		    entry_before(search->heap[child + 1], search->heap[child]))
			child++;
		if (!entry_before(search->heap[child], last))
			break;
		search->heap[at] = search->heap[child];
		at = child;
	}
	search->heap[at] = last;
	return top;
}

static float step_cost(const struct ground *ground, uint32_t to, unsigned direction)
{
	const struct stand *stand = &ground->stands[to];
	float length = direction < 4 ? 1.0f : 1.4142135f;
	float edge = stand->edge_steps / (float)ground->walker.radius;

	return length * (1.0f + EDGE_COST / (1.0f + edge)) *
	       (stand->is_roofed ? 1.0f : UNROOFED_COST);
}

/* Ways from one stand to all that it can reach. */
static int search_run(const struct ground *ground, uint32_t start, struct search *search)
{
	for (uint32_t i = 0; i < ground->stand_count; i++)
		search->costs[i] = INFINITY;
	search->heap_count = 0;
	search->costs[start] = 0.0f;
	search->came_from[start] = start;
	if (heap_push(search, (struct heap_entry){ 0.0f, start }) < 0)
		return -ENOMEM;
	while (search->heap_count > 0) {
		struct heap_entry entry = heap_pop(search);

		if (entry.cost > search->costs[entry.stand])
			continue;
		for (unsigned direction = 0; direction < 8; direction++) {
			uint32_t beside = stand_beside(ground, entry.stand, direction);
			float cost;

			if (beside == UINT32_MAX)
				continue;
			cost = entry.cost + step_cost(ground, beside, direction);
			if (cost >= search->costs[beside])
				continue;
			search->costs[beside] = cost;
			search->came_from[beside] = entry.stand;
			if (heap_push(search, (struct heap_entry){ cost, beside }) < 0)
				return -ENOMEM;
		}
	}
	return 0;
}

/* How much there is to see around a stand: triangles within half a storey. */
static uint64_t detail_around(const struct ground *ground, const struct stand *stand)
{
	const struct occupancy *occupancy = ground->occupancy;
	uint32_t reach = (uint32_t)(0.5 * ground->walker.storey);
	uint32_t x0 = stand->x > reach ? stand->x - reach : 0;
	uint32_t y0 = stand->y > reach ? stand->y - reach : 0;
	uint64_t sum = 0;

	for (uint32_t y = y0; y <= stand->y + reach && y < occupancy->size[1]; y++)
		for (uint32_t x = x0; x <= stand->x + reach && x < occupancy->size[0]; x++)
			sum += occupancy->detail[(size_t)y * occupancy->size[0] + x];
	return sum;
}

/*
 * A stand of the component, under a roof and off the edge if a few tries find one; of some such the
 * one with most to see.
 */
static uint32_t stand_random(struct ground *ground)
{
	uint32_t found = ground->component;
	uint64_t found_detail = 0;
	unsigned found_count = 0;

	for (unsigned i = 0; i < ROOFED_TRIES && found_count < DETAIL_CHOICES; i++) {
		uint32_t index = (uint32_t)(random_next(&ground->random) % ground->stand_count);
		const struct stand *stand = &ground->stands[index];
		uint64_t detail;

		if (stand->component != ground->component)
			continue;
		if (found_count == 0)
			found = index;
		if (ground->has_roof && !stand->is_roofed)
			continue;
		detail = detail_around(ground, stand);
		if (found_count++ == 0 || detail > found_detail) {
			found = index;
			found_detail = detail;
		}
	}
	return found;
}

/* ---- the way ---- */

struct way {
	double (*points)[3];
	size_t count;
	size_t room;
	double length;
};

static int way_append(struct way *way, const struct stand *stand)
{
	double point[3] = { stand->x + 0.5, stand->y + 0.5, stand->z + 0.5 };

	if (way->count == way->room) {
		size_t room = 2 * way->room + 1024;
		double(*grown)[3] = reallocarray(way->points, room, sizeof(*grown));

		if (!grown)
			return -ENOMEM;
		way->points = grown;
		way->room = room;
	}
	if (way->count > 0)
		way->length += hypot(point[0] - way->points[way->count - 1][0],
				     point[1] - way->points[way->count - 1][1]);
	memcpy(way->points[way->count++], point, sizeof(point));
	return 0;
}

/* Appends the way that a search found, forwards. */
static int way_extend(const struct ground *ground, const struct search *search, uint32_t goal,
		      struct way *way)
{
	size_t count = 1;
	uint32_t *backwards;
	int r = 0;

	for (uint32_t at = goal; search->came_from[at] != at; at = search->came_from[at])
		count++;
	backwards = malloc(count * sizeof(*backwards));
	if (!backwards)
		return -ENOMEM;
	for (size_t i = 0; i < count; i++) {
		backwards[i] = goal;
		goal = search->came_from[goal];
	}
	for (size_t i = count; i-- > 0 && r == 0;)
		r = way_append(way, &ground->stands[backwards[i]]);
	free(backwards);
	return r;
}

/* From one far goal to the next until the way is long enough. */
static int way_find(struct ground *ground, double length, struct way *way, struct why *why)
{
	struct search search = { 0 };
	uint32_t at = stand_random(ground);
	int r = 0;

	search.costs = malloc(ground->stand_count * sizeof(*search.costs));
	search.came_from = malloc(ground->stand_count * sizeof(*search.came_from));
	if (!search.costs || !search.came_from)
		r = -ENOMEM;
	while (r == 0 && way->length < length) {
		uint32_t goal = at;

		r = measure_was_cancelled() ? -ECANCELED : search_run(ground, at, &search);
		for (unsigned i = 0; r == 0 && i < GOAL_CANDIDATES; i++) {
			uint32_t candidate = stand_random(ground);

			if (isfinite(search.costs[candidate]) &&
			    search.costs[candidate] > search.costs[goal])
				goal = candidate;
		}
		if (r == 0 && goal == at)
			r = -ENODATA;
		if (r == 0)
			r = way_extend(ground, &search, goal, way);
		at = goal;
	}
	free(search.costs);
	free(search.came_from);
	free(search.heap);
	if (r == -ENODATA)
		return why_set(why, r, "there is no room to walk in; --kind orbit needs none");
	return r < 0 ? why_errno(why, r, "no walk") : 0;
}

/* Draws each point towards its neighbours' middle where nothing is in the way. */
static void way_smooth(const struct ground *ground, struct way *way)
{
	for (unsigned round = 0; round < SMOOTHING_ROUNDS; round++)
		for (size_t i = 1; i + 1 < way->count; i++) {
			double moved[3];

			for (unsigned k = 0; k < 3; k++)
				moved[k] = 0.25 * (way->points[i - 1][k] + way->points[i + 1][k]) +
					   0.5 * way->points[i][k];
			if (is_free(ground->occupancy, &ground->walker, moved,
				    ground->walker.radius))
				memcpy(way->points[i], moved, sizeof(moved));
		}
}

/* Points at equal distances along the way, until it or the room ends. */
static size_t way_resample(const struct way *way, double spacing, struct walk_point *points,
			   size_t point_count)
{
	double next = 0.0; /* distance from the segment's start to the next point */
	size_t count = 0;

	for (size_t i = 1; i < way->count && count < point_count; i++) {
		const double *from = way->points[i - 1];
		const double *to = way->points[i];
		double length = sqrt((to[0] - from[0]) * (to[0] - from[0]) +
				     (to[1] - from[1]) * (to[1] - from[1]) +
				     (to[2] - from[2]) * (to[2] - from[2]));

		for (; next < length && count < point_count; next += spacing, count++)
			for (unsigned k = 0; k < 3; k++)
				points[count].at[k] = from[k] + (to[k] - from[k]) * (next / length);
		next -= length;
	}
	return count;
}

static int ground_make(struct ground *ground, struct why *why)
{
	int r = stands_find(ground);

	if (r == 0)
		r = components_find(ground);
	if (r == -ENODATA)
		return why_set(why, r, "there is no floor to walk on; --kind orbit needs none");
	if (r == 0)
		r = edges_find(ground);
	return r < 0 ? why_errno(why, r, "no walk") : 0;
}

static struct walker walker_of_storey(double storey)
{
	return (struct walker){
		.storey = storey,
		.eye = EYE_SHARE * storey,
		.head = HEAD_SHARE * storey,
		.knee = KNEE_SHARE * storey,
		.radius = RADIUS_SHARE * storey,
		.step = (uint32_t)fmax(1.0, rint(STEP_SHARE * storey)),
	};
}

int walk_make(const struct occupancy *fine, double storey, uint64_t seed, size_t point_count,
	      struct walk *ret, struct why *why)
{
	struct walk walk = { .storey = storey / fine->voxel };
	struct ground ground = { .occupancy = fine,
				 .walker = walker_of_storey(walk.storey),
				 .random = { seed } };
	struct way way = { 0 };
	double length;
	int r;

	r = ground_make(&ground, why);
	if (r < 0)
		goto out;
	walk.spacing = SPACING_SHARE * walk.storey;
	length = walk.spacing * (double)(point_count + 1);
	walk.points = calloc(point_count, sizeof(*walk.points));
	if (!walk.points) {
		r = why_errno(why, -ENOMEM, "no walk");
		goto out;
	}
	/* Corners are cut by smoothing, so the first way has to be longer. */
	r = way_find(&ground, length / SMOOTHING_SHRINKS + walk.storey, &way, why);
	if (r < 0)
		goto out;
	way_smooth(&ground, &way);
	walk.point_count = way_resample(&way, walk.spacing, walk.points, point_count);
	*ret = walk;
	walk.points = NULL;
out:
	free(walk.points);
	free(way.points);
	free(ground.stands);
	free(ground.first_of_column);
	return r;
}

void walk_done(struct walk *walk)
{
	free(walk->points);
	walk->points = NULL;
}
