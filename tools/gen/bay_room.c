/* SPDX-License-Identifier: MIT */
#include "formats/base/bytes.h"
#include "tools/gen/bay.h"

#define STREAM_ROOM  (UINT64_C(2) << 60)
#define STREAM_SHAFT (UINT64_C(3) << 60)

/* Clear way along the walls, and the pitch of the machines' places. */
#define ROOM_MARGIN 0.9
#define ROOM_PITCH  2.6
/* Height of the lowest pipes under the ceiling. */
#define ROOM_PIPES 2.95

static uint64_t bay_number(const struct bay *bay)
{
	uint64_t number = bay->floor;

	number = number * bay->plant->row_count + bay->row;
	return number * bay->plant->column_count + bay->column;
}

/* ---- shafts ---- */

enum bay_shaft bay_shaft(const struct bay *bay)
{
	struct random random = random_stream(bay->plant->seed, STREAM_SHAFT | bay_number(bay));

	if (bay->floor + 1 >= bay->plant->floor_count || bay_is_corridor(bay->row))
		return BAY_SHAFT_NONE;
	if (bay->row % 3 == 0 && bay->column % 8 == (bay->row * 3) % 8)
		return BAY_SHAFT_STAIRS;
	/* On every other floor, so that shafts do not stand on each other. */
	if ((bay->floor + bay->column) % 2 == 0 && random_chance(&random, 0.3))
		return BAY_SHAFT_VESSEL;
	return BAY_SHAFT_NONE;
}

/* Stairs go up east on even floors and west on odd ones, in two lanes. */
static double stairs_length(const struct bay *bay)
{
	return bay->width - 2.6 < 5.4 ? bay->width - 2.6 : 5.4;
}

struct opening bay_shaft_opening(const struct bay *bay)
{
	double middle_x = bay->width / 2;
	double middle_y = bay->depth / 2;

	if (bay_shaft(bay) == BAY_SHAFT_STAIRS) {
		double lane = bay->floor % 2 == 0 ? 1.5 : 3.4;
		double half = stairs_length(bay) / 2;

		return (struct opening){ middle_x - half + 0.3, lane - 0.75, middle_x + half,
					 lane + 0.75 };
	}
	return (struct opening){ middle_x - 1.3, middle_y - 1.3, middle_x + 1.3, middle_y + 1.3 };
}

static void railing_around(struct mesh *mesh, const struct bay *bay, const struct opening *o,
			   bool open_west, bool open_east)
{
	struct frame floor = frame_at(&bay->frame, 0, 0, BAY_FLOOR_HEIGHT);
	struct frame side = frame_at(&floor, o->low_x, o->low_y - 0.06, 0);

	machine_railing(mesh, &side, o->high_x - o->low_x);
	side = frame_at(&floor, o->low_x, o->high_y + 0.06, 0);
	machine_railing(mesh, &side, o->high_x - o->low_x);
	if (!open_west) {
		side = frame_at(&floor, o->low_x - 0.06, o->low_y, 0);
		side = frame_turned(&side, turn_of(1, 4));
		machine_railing(mesh, &side, o->high_y - o->low_y);
	}
	if (!open_east) {
		side = frame_at(&floor, o->high_x + 0.06, o->low_y, 0);
		side = frame_turned(&side, turn_of(1, 4));
		machine_railing(mesh, &side, o->high_y - o->low_y);
	}
}

void bay_shaft_contents(struct mesh *mesh, const struct bay *bay, struct random *random)
{
	struct opening o = bay_shaft_opening(bay);
	struct frame part;

	switch (bay_shaft(bay)) {
	case BAY_SHAFT_NONE:
		return;
	case BAY_SHAFT_STAIRS:
		part = frame_at(&bay->frame, bay->width / 2, (o.low_y + o.high_y) / 2, 0);
		if (bay->floor % 2 == 1)
			part = frame_turned(&part, turn_of(1, 2));
		part = frame_at(&part, -stairs_length(bay) / 2, 0, 0);
		machine_stairs(mesh, &part, stairs_length(bay), BAY_FLOOR_HEIGHT, 1.2);
		railing_around(mesh, bay, &o, bay->floor % 2 == 1, bay->floor % 2 == 0);
		return;
	case BAY_SHAFT_VESSEL:
		part = frame_at(&bay->frame, bay->width / 2, bay->depth / 2, -MACHINE_SUNK);
		machine_tank(mesh, &part, random, 3 * BAY_FLOOR_HEIGHT);
		railing_around(mesh, bay, &o, false, false);
		return;
	}
}

/* ---- rooms ---- */

struct theme {
	machine_fn machines[4];
	unsigned place_percent; /* how many of the places are taken */
	unsigned rack_count_max;
};

static const struct theme themes[] = {
	{ { machine_pump, machine_pump, machine_pump, machine_manifold }, 85, 3 },
	{ { machine_tank, machine_tank, machine_drum, machine_manifold }, 80, 3 },
	{ { machine_exchanger, machine_exchanger, machine_drum, machine_pump }, 85, 3 },
	{ { machine_cabinets, machine_cabinets, machine_cabinets, machine_cabinets }, 70, 1 },
	{ { machine_pump, machine_drum, machine_tank, machine_cabinets }, 75, 2 },
	{ { machine_manifold, machine_manifold, machine_pump, machine_tank }, 90, 4 },
};

static bool near_opening(const struct opening *o, double x, double y)
{
	const double near = MACHINE_SLOT / 2 + 0.3;

	return x > o->low_x - near && x < o->high_x + near && y > o->low_y - near &&
	       y < o->high_y + near;
}

static void place_machines(struct mesh *mesh, const struct bay *bay, struct random *random)
{
	const struct theme *theme = &themes[random_below(random, ARRAY_LENGTH(themes))];
	unsigned columns = (unsigned)((bay->width - 2 * ROOM_MARGIN) / ROOM_PITCH);
	unsigned rows = (unsigned)((bay->depth - 2 * ROOM_MARGIN) / ROOM_PITCH);
	struct bay below = *bay;
	struct opening openings[2];
	unsigned opening_count = 0;

	if (bay_shaft(bay) != BAY_SHAFT_NONE)
		openings[opening_count++] = bay_shaft_opening(bay);
	if (bay->floor > 0) {
		below.floor--;
		if (bay_shaft(&below) != BAY_SHAFT_NONE)
			openings[opening_count++] = bay_shaft_opening(&below);
	}
	for (unsigned place = 0; place < columns * rows; place++) {
		double x = bay->width / 2 + (place % columns - 0.5 * (columns - 1)) * ROOM_PITCH;
		double y = bay->depth / 2 + (place / columns - 0.5 * (rows - 1)) * ROOM_PITCH;
		struct random own = { random_next(random) };
		struct frame frame = frame_at(&bay->frame, x, y, -MACHINE_SUNK);
		bool blocked = !bay_furnished(bay->plant, &own, theme->place_percent / 100.0);

		for (unsigned i = 0; i < opening_count; i++)
			blocked |= near_opening(&openings[i], x, y);
		if (blocked)
			continue;
		frame = frame_turned(&frame, turn_of(2 * random_below(&own, 2), 4));
		theme->machines[random_below(&own, 4)](mesh, &frame, &own, bay->height + 0.03);
	}
	for (unsigned i = 0; i < theme->rack_count_max; i++) {
		double y =
			bay->depth * (i + random_between(random, 0.2, 0.6)) / theme->rack_count_max;
		double z = ROOM_PIPES + random_between(random, 0, 0.4);
		struct frame rack = frame_at(&bay->frame, 0, y, z);

		if (bay_furnished(bay->plant, random, 0.75))
			machine_pipe_rack(mesh, &rack, random, bay->width, bay->height - z);
	}
}

static void lamps(struct mesh *mesh, const struct bay *bay, unsigned count, double y)
{
	for (unsigned i = 0; i < count; i++) {
		struct frame lamp =
			frame_at(&bay->frame, bay->width * (i + 0.5) / count, y, bay->height);

		machine_lamp(mesh, &lamp);
	}
}

void bay_room(struct mesh *mesh, const struct bay *bay)
{
	struct random random = random_stream(bay->plant->seed, STREAM_ROOM | bay_number(bay));
	struct frame part;

	place_machines(mesh, bay, &random);
	bay_shaft_contents(mesh, bay, &random);
	if (bay_furnished(bay->plant, &random, 0.5)) {
		part = frame_at(&bay->frame, 0, random_between(&random, 0.8, bay->depth - 0.8),
				bay->height - 0.71);
		machine_duct(mesh, &part, bay->width, random_between(&random, 0.4, 0.7));
	}
	if (bay_furnished(bay->plant, &random, 0.7)) {
		part = frame_at(&bay->frame, 0.5, 0.6, 2.75);
		machine_tray(mesh, &part, &random, bay->width - 1, bay->height - 2.75);
	}
	lamps(mesh, bay, 2, bay->depth * 0.27);
	lamps(mesh, bay, 2, bay->depth * 0.73);
}

void bay_corridor(struct mesh *mesh, const struct bay *bay)
{
	struct random random = random_stream(bay->plant->seed, STREAM_ROOM | bay_number(bay));
	struct frame part = frame_at(&bay->frame, 0, 0.4, 3.1);

	if (bay_furnished(bay->plant, &random, 1))
		machine_pipe_rack(mesh, &part, &random, bay->width, bay->height - 3.1);
	part = frame_at(&bay->frame, 0, bay->depth - 0.5, 2.9);
	machine_tray(mesh, &part, &random, bay->width, bay->height - 2.9);
	lamps(mesh, bay, 2, bay->depth * 0.6);
}
