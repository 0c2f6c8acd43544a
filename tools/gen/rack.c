/* SPDX-License-Identifier: MIT */
#include "tools/gen/rack.h"

#include <errno.h>
#include <inttypes.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "formats/base/log.h"
#include "tools/gen/out_file.h"
#include "tools/gen/rack_place.h"
#include "tools/gen/rack_read.h"
#include "tools/gen/rack_room.h"

#define MATERIALS_NAME "rooms.mtl"
#define LIST_HEADER    "file,m00,m01,m02,m03,m10,m11,m12,m13,m20,m21,m22,m23\n"

/* One line of the list that is a model, while its place is not known: the linear part. */
struct rack_copy {
	size_t model_index;
	double turn[9];        /* row-major 3x3, model to world */
	struct vec3 underside; /* the middle of the turned box's underside */
};

/* All that is known of the scene. */
struct rack {
	const struct rack_wish *wish;
	struct import_inputs inputs;
	struct rack_model *models;
	struct rack_copy *copies;
	struct rack_item *items; /* one a copy */
	size_t copy_count;
	struct rack_layout layout;
	char *list_folder;      /* its real path */
	char *rooms_folder;     /* LIST.d */
	const char *rooms_name; /* its last part */
};

static void rack_done(struct rack *rack)
{
	import_inputs_done(&rack->inputs);
	rack_layout_done(&rack->layout);
	free(rack->models);
	free(rack->copies);
	free(rack->items);
	free(rack->list_folder);
	free(rack->rooms_folder);
}

static int no_memory(struct why *why)
{
	return why_set(why, -ENOMEM, "out of memory");
}

/* ---- what there is ---- */

static int find_folders(struct rack *rack, struct why *why)
{
	const char *list = rack->wish->list_path;
	const char *slash = strrchr(list, '/');
	size_t length = strlen(list);
	char *folder = slash ? strndup(list, (size_t)(slash - list) + 1) : strdup(".");

	if (!folder)
		return no_memory(why);
	rack->list_folder = realpath(folder, NULL);
	free(folder);
	if (!rack->list_folder)
		return why_errno(why, -errno, "%s: cannot be made", list);
	if (length > 4 && strcmp(list + length - 4, ".csv") == 0)
		length -= 4;
	if (asprintf(&rack->rooms_folder, "%.*s.d", (int)length, list) < 0) {
		rack->rooms_folder = NULL;
		return no_memory(why);
	}
	slash = strrchr(rack->rooms_folder, '/');
	rack->rooms_name = slash ? slash + 1 : rack->rooms_folder;
	return 0;
}

static int read_models(struct rack *rack, struct why *why)
{
	char *scratch;
	int r;

	for (size_t i = 0; i < rack->inputs.input_count; i++) {
		if (rack->inputs.inputs[i].placed)
			return why_set(why, -EINVAL,
				       "%s: is placed by a scene list; give folders and models",
				       rack->inputs.inputs[i].path);
	}
	rack->models = calloc(rack->inputs.input_count, sizeof(*rack->models));
	if (!rack->models || asprintf(&scratch, "%s/.oocgen-XXXXXX", rack->list_folder) < 0)
		return no_memory(why);
	if (!mkdtemp(scratch)) {
		r = why_errno(why, -errno, "%s: cannot be written", rack->list_folder);
	} else {
		r = rack_read(&rack->inputs, rack->models, scratch, rack->wish->jobs, why);
		(void)rmdir(scratch);
	}
	free(scratch);
	return r;
}

static void judge_models(const struct rack *rack, struct rack_report *report)
{
	report->models = rack->inputs.input_count;
	for (size_t i = 0; i < rack->inputs.input_count; i++) {
		const struct rack_model *model = &rack->models[i];

		if (model->error < 0) {
			log_warning("%s, leaving it out", model->why.text);
			report->unreadable++;
		} else if (model->triangle_count == 0) {
			report->empty++;
		} else {
			report->placed += rack->wish->copy_count;
			report->triangles += rack->wish->copy_count * model->triangle_count;
		}
	}
}

/* ---- how each lies ---- */

/* Which axis of the model becomes x, y and z, and with which sign, so that its up is z. */
static const struct upright {
	uint8_t from[3];
	int8_t sign[3];
} uprights[] = {
	[STORE_AXIS_X] = { { 1, 2, 0 }, { 1, 1, 1 } },
	[STORE_AXIS_Y] = { { 0, 2, 1 }, { 1, -1, 1 } },
	[STORE_AXIS_Z] = { { 0, 1, 2 }, { 1, 1, 1 } },
};

static void turn_copy(const struct rack *rack, struct rack_copy *copy, struct rack_item *item,
		      struct turn turn)
{
	const struct rack_model *model = &rack->models[copy->model_index];
	enum store_axis up =
		rack->wish->up_axis != STORE_AXIS_UNKNOWN ? rack->wish->up_axis : model->up_axis;
	const struct upright *upright = &uprights[up != STORE_AXIS_UNKNOWN ? up : STORE_AXIS_Z];
	const double rotation[3][3] = { { turn.cosine, -turn.sine, 0 },
					{ turn.sine, turn.cosine, 0 },
					{ 0, 0, 1 } };
	double middle[3] = { 0 };
	double half[3] = { 0 };

	for (int row = 0; row < 3; row++) {
		for (int k = 0; k < 3; k++) {
			int column = upright->from[k];
			double entry = rotation[row][k] * upright->sign[k];

			/* + 0.0 makes no difference but for -0, which reads badly. */
			copy->turn[3 * row + column] = entry + 0.0;
			middle[row] += entry * (model->low[column] / 2 + model->high[column] / 2);
			half[row] +=
				fabs(entry) * (model->high[column] / 2 - model->low[column] / 2);
		}
	}
	item->size = (struct vec3){ 2 * half[0], 2 * half[1], 2 * half[2] };
	copy->underside = (struct vec3){ middle[0], middle[1], middle[2] - half[2] };
}

static int turn_models(struct rack *rack, uint64_t placed_count, struct why *why)
{
	rack->copies = calloc(placed_count, sizeof(*rack->copies));
	rack->items = calloc(placed_count, sizeof(*rack->items));
	if (!rack->copies || !rack->items)
		return no_memory(why);
	for (uint64_t copy = 0; copy < rack->wish->copy_count; copy++) {
		for (size_t i = 0; i < rack->inputs.input_count; i++) {
			struct random random = random_stream(rack->wish->seed,
							     copy * rack->inputs.input_count + i);

			if (rack->models[i].error < 0 || rack->models[i].triangle_count == 0)
				continue;
			rack->copies[rack->copy_count].model_index = i;
			turn_copy(rack, &rack->copies[rack->copy_count],
				  &rack->items[rack->copy_count], turn_random(&random));
			rack->copy_count++;
		}
	}
	return 0;
}

/* ---- what is written ---- */

static char *room_path(const struct rack *rack, size_t room)
{
	char *path;

	return asprintf(&path, "%s/room-%04zu.obj", rack->rooms_folder, room) < 0 ? NULL : path;
}

/* Removes the rooms from one on, also those of an earlier, larger scene. */
static void remove_rooms(const struct rack *rack, size_t first)
{
	for (size_t room = first;; room++) {
		char *path = room_path(rack, room);
		bool was_there = path && unlink(path) == 0;

		free(path);
		if (!was_there && room >= rack->layout.room_count)
			return;
	}
}

static char *materials_path(const struct rack *rack)
{
	char *path;

	return asprintf(&path, "%s/" MATERIALS_NAME, rack->rooms_folder) < 0 ? NULL : path;
}

static int write_materials(const struct rack *rack, struct why *why)
{
	char *path = materials_path(rack);
	struct out_file out;
	int r;

	if (!path)
		return no_memory(why);
	r = out_file_open(&out, path, why);
	if (r == 0) {
		rack_room_materials(&out);
		r = out_file_commit(&out, why);
		out_file_done(&out);
	}
	free(path);
	return r;
}

/* What a failure leaves: nothing. */
static void remove_folder(const struct rack *rack)
{
	char *path = materials_path(rack);

	if (path)
		(void)unlink(path);
	free(path);
	remove_rooms(rack, 0);
	(void)rmdir(rack->rooms_folder);
}

static int write_rooms(const struct rack *rack, struct why *why)
{
	int r;

	if (mkdir(rack->rooms_folder, 0777) < 0 && errno != EEXIST)
		return why_errno(why, -errno, "%s: cannot be made", rack->rooms_folder);
	r = write_materials(rack, why);
	for (size_t i = 0; i < rack->layout.room_count && r == 0; i++) {
		char *path = room_path(rack, i);
		struct mesh_file file = { .path = path,
					  .description = "a room of a rack",
					  .materials = MATERIALS_NAME };

		if (!path)
			return no_memory(why);
		r = mesh_write_file(&file, rack_room_make, &rack->layout.rooms[i], NULL, why);
		free(path);
	}
	if (r == 0)
		remove_rooms(rack, rack->layout.room_count);
	return r;
}

/* The way from the list's folder to a file, both real paths.  Ownership: free(). */
static char *relative_path(const char *folder, const char *path)
{
	size_t common = 0;
	size_t up_count = 0;
	char *relative;
	char *end;

	for (size_t i = 0; folder[i] != '\0' && folder[i] == path[i]; i++) {
		if (path[i] == '/')
			common = i + 1;
	}
	/* The folder itself may be the last common part. */
	if (strncmp(folder, path, strlen(folder)) == 0 && path[strlen(folder)] == '/')
		common = strlen(folder) + 1;
	if (common <= strlen(folder) && folder[common] != '\0') {
		up_count = 1;
		for (const char *c = folder + common; *c != '\0'; c++)
			up_count += *c == '/';
	}
	relative = malloc(3 * up_count + strlen(path + common) + 1);
	if (!relative)
		return NULL;
	end = relative;
	for (size_t i = 0; i < up_count; i++)
		end = stpcpy(end, "../");
	strcpy(end, path + common);
	return relative;
}

/* A field of CSV: quoted where it has to be. */
static void write_field(struct out_file *out, const char *text)
{
	bool quoted = strpbrk(text, ",\"") != NULL || text[0] == ' ';

	if (quoted)
		out_file_printf(out, "\"");
	for (; *text != '\0'; text++)
		out_file_printf(out, quoted && *text == '"' ? "\"\"" : "%c", *text);
	if (quoted)
		out_file_printf(out, "\"");
}

static void write_line(struct out_file *out, const char *file, const double turn[9],
		       struct vec3 place)
{
	const double places[3] = { place.x, place.y, place.z };

	write_field(out, file);
	for (int row = 0; row < 3; row++)
		out_file_printf(out, ",%.17g,%.17g,%.17g,%.17g", turn[3 * row], turn[3 * row + 1],
				turn[3 * row + 2], places[row] + 0.0);
	out_file_printf(out, "\n");
}

static void write_room_lines(const struct rack *rack, struct out_file *out)
{
	for (size_t i = 0; i < rack->layout.room_count; i++) {
		const struct frame *frame = &rack->layout.rooms[i].frame;
		const double turn[9] = { frame->x.x, 0, 0, 0, frame->y.y, 0, 0, 0, 1 };
		char name[PATH_MAX];

		(void)snprintf(name, sizeof(name), "%s/room-%04zu.obj", rack->rooms_name, i);
		write_line(out, name, turn, frame->origin);
	}
}

static int write_copy_line(const struct rack *rack, struct out_file *out, size_t index,
			   struct why *why)
{
	const struct rack_copy *copy = &rack->copies[index];
	const struct vec3 place = rack->items[index].place;
	const char *given = rack->inputs.inputs[copy->model_index].path;
	char *real = realpath(given, NULL);
	char *relative;

	if (!real)
		return why_errno(why, -errno, "%s", given);
	if (strpbrk(real, "\r\n")) {
		free(real);
		return why_set(why, -EINVAL,
			       "%s: a scene list cannot hold a path with a line break; rename it",
			       given);
	}
	relative = relative_path(rack->list_folder, real);
	free(real);
	if (!relative)
		return no_memory(why);
	write_line(out, relative, copy->turn, vec3_add_scaled(place, copy->underside, -1));
	free(relative);
	return 0;
}

static int write_list(const struct rack *rack, struct why *why)
{
	struct out_file out;
	int r;

	r = out_file_open(&out, rack->wish->list_path, why);
	if (r < 0)
		return r;
	out_file_printf(&out, LIST_HEADER);
	write_room_lines(rack, &out);
	for (size_t i = 0; i < rack->copy_count && r == 0; i++)
		r = write_copy_line(rack, &out, i, why);
	if (r == 0)
		r = out_file_commit(&out, why);
	out_file_done(&out);
	return r;
}

static int write_all(struct rack *rack, struct why *why)
{
	int r = rack_place(rack->items, rack->copy_count, &rack->layout);

	if (r < 0)
		return no_memory(why);
	r = write_rooms(rack, why);
	if (r == 0)
		r = write_list(rack, why);
	if (r < 0)
		remove_folder(rack);
	return r;
}

int rack_write(const struct rack_wish *wish, struct rack_report *ret, struct why *why)
{
	struct rack rack = { .wish = wish };
	struct rack_report report = { 0 };
	int r;

	r = find_folders(&rack, why);
	if (r == 0)
		r = import_inputs_expand(wish->arguments, wish->argument_count, &rack.inputs, why);
	if (r == 0)
		r = read_models(&rack, why);
	if (r == 0) {
		judge_models(&rack, &report);
		if (report.placed == 0)
			r = why_set(why, -ENODATA,
				    "nothing to place: %" PRIu64 " models were found, %" PRIu64
				    " without triangles, %" PRIu64 " that cannot be read",
				    report.models, report.empty, report.unreadable);
	}
	if (r == 0)
		r = turn_models(&rack, report.placed, why);
	if (r == 0)
		r = write_all(&rack, why);
	report.rooms = rack.layout.room_count;
	if (r == 0)
		*ret = report;
	rack_done(&rack);
	return r;
}
