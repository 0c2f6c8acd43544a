/* SPDX-License-Identifier: MIT */
/* Goal: oocgen as people run it: memory, failures that leave nothing, lists that can be read. */
#include <math.h>
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/inotify.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>

#include "formats/base/bytes.h"
#include "formats/import/import.h"
#include "tests/helper.h"
#include "tools/gen/rack_read.h"

static char output[1 << 14];

#define RUN(...) test_command(output, sizeof(output), __VA_ARGS__)

static void assert_run(int status, const char *words)
{
	if (status != 0)
		fail_msg("exit %d: %s", status, output);
	assert_non_null(strstr(output, words));
}

/* ---- memory and interruption ---- */

/* Starts `oocgen plant --triangles TRIANGLES -o PATH`. */
static pid_t start_plant(const char *triangles, const char *path)
{
	char program[4096];
	pid_t pid;

	(void)snprintf(program, sizeof(program), "%s/oocgen", getenv("OOCD_BIN"));
	pid = test_fork();
	if (pid == 0) {
		(void)execl(program, program, "plant", "--triangles", triangles, "-o", path, NULL);
		_exit(127);
	}
	return pid;
}

static void memory_does_not_grow_with_the_plant(void **state)
{
	const char *path = test_path(*state, "plant.ply");
	struct rusage usage;
	int status;

	assert_true(wait4(start_plant("5000000", path), &status, 0, &usage) > 0);
	assert_true(WIFEXITED(status) && WEXITSTATUS(status) == 0);
	print_message("5 million triangles in %ld KiB\n", usage.ru_maxrss);
#ifndef OOCD_SANITIZED
	assert_true((uint64_t)usage.ru_maxrss * KIB < 64 * MIB);
#endif
}

static void an_interrupted_plant_leaves_no_file(void **state)
{
	char *path = strdup(test_path(*state, "plant.ply"));
	int watch = inotify_init1(IN_CLOEXEC);
	char event[4096];
	pid_t pid;

	assert_true(inotify_add_watch(watch, *state, IN_CREATE) >= 0);
	pid = start_plant("100000000", path);
	/* Its temporary file is there: now it writes. */
	assert_true(read(watch, event, sizeof(event)) > 0);
	assert_int_equal(kill(pid, SIGTERM), 0);
	assert_int_equal(test_wait(pid), 1);
	(void)close(watch);
	assert_string_equal(test_folder_list(*state), "");
	free(path);
}

/* ---- output ---- */

static void standard_output_gets_the_same_bytes(void **state)
{
	const char *folder = *state;

	assert_run(RUN("cd %s && $OOCD_BIN/oocgen plant --triangles 20000 --seed 9 -o a.ply && "
		       "$OOCD_BIN/oocgen plant --triangles 20000 --seed 9 -o - >b.ply && "
		       "cmp a.ply b.ply && head -c 300 a.ply",
		       folder),
		   "comment up z");
	assert_run(RUN("$OOCD_BIN/oocgen scene soup --triangles 500 -o %s/s.ply --json", folder),
		   "\"triangles\": 500");
	/* Whole files have the rights of any other new file. */
	assert_run(RUN("cd %s && umask 022 && $OOCD_BIN/oocgen scene soup --triangles 500 -o u.ply "
		       "&& stat -c %%a u.ply",
		       folder),
		   "644");
}

static void a_full_disk_leaves_what_was_there(void **state)
{
	const char *folder = *state;
	const char *path = test_path(folder, "plant.ply");
	void *kept;
	size_t kept_bytes;

	assert_int_equal(RUN("$OOCD_BIN/oocgen plant --triangles 20000 -o /dev/full"), 1);
	assert_non_null(strstr(output, "/dev/full: cannot be written: No space left on device"));

	test_file_write(path, "kept", 4);
	/* The limit of file sizes stands in for the disk's. */
	assert_int_equal(RUN("ulimit -f 64; trap '' XFSZ; $OOCD_BIN/oocgen plant "
			     "--triangles 20000 -o %s",
			     path),
			 1);
	assert_non_null(strstr(output, "cannot be written"));
	assert_string_equal(test_folder_list(folder), "plant.ply ");
	kept = test_file_read(path, &kept_bytes);
	assert_int_equal(kept_bytes, 4);
	free(kept);

	assert_int_equal(RUN("$OOCD_BIN/oocgen plant --triangles 20000 -o %s/no/plant.ply", folder),
			 1);
	assert_int_equal(RUN("$OOCD_BIN/oocgen plant --triangles 20000 -o %s", folder), 1);
}

static void wrong_usage_is_told_in_one_line(void **state)
{
	static const struct {
		const char *arguments;
		const char *words;
	} cases[] = {
		{ "", "no verb" },
		{ "house -o x", "no such verb: house" },
		{ "plant --triangles 20000", "no output" },
		{ "plant --triangles 9999 -o x", "at least 10000" },
		{ "plant -o x", "at least 10000" },
		{ "plant --triangles 1e6 -o x", "a whole number" },
		{ "plant --triangles 99999999999 -o x", "a whole number" },
		{ "plant --triangles 20000 --seed -1 -o x", "a whole number" },
		{ "plant --triangles 20000 --copies 2 -o x", "not an option of this verb" },
		{ "plant --triangles 20000 -o x y", "too much" },
		{ "plant --bricks", "unrecognized option" },
		{ "scene --triangles 500 -o x", "no scene" },
		{ "scene city --triangles 500 -o x", "no such scene: city" },
		{ "scene soup --triangles 99 -o x", "at least 100" },
		{ "scene soup --triangles 500 --origin 1,2 -o x", "three numbers" },
		{ "scene soup --triangles 500 --origin 1,2,3,4 -o x", "three numbers" },
		{ "scene soup --triangles 500 --origin 1,nan,3 -o x", "three numbers" },
		{ "rack -o x.csv", "no folder" },
		{ "rack -o - .", "files beside it" },
		{ "rack --up w -o x.csv .", "x, y or z" },
		{ "rack --copies 0 -o x.csv .", "a whole number" },
		{ "rack --triangles 5 -o x.csv .", "not an option of this verb" },
	};

	for (size_t i = 0; i < ARRAY_LENGTH(cases); i++) {
		print_message("oocgen %s\n", cases[i].arguments);
		assert_int_equal(RUN("cd %s && $OOCD_BIN/oocgen %s", (const char *)*state,
				     cases[i].arguments),
				 2);
		assert_non_null(strstr(output, cases[i].words));
		assert_ptr_equal(strstr(output, "oocgen: "), output);
		assert_ptr_equal(strchr(output, '\n'), output + strlen(output) - 1);
		assert_string_equal(test_folder_list(*state), "");
	}
	assert_run(RUN("$OOCD_BIN/oocgen --help"), "Examples:");
	assert_run(RUN("$OOCD_BIN/oocgen plant --help"), "coplanar");
	assert_run(RUN("$OOCD_BIN/oocgen --version"), "oocgen ");
}

/* ---- racks ---- */

/* A folder of nine models of different sizes, one without triangles, one that is no model. */
static void make_models(const char *folder)
{
	assert_int_equal(
		RUN("cd %s && mkdir -p models/small 'models/a, \"b\"' && "
		    "for seed in 1 2 3 4; do "
		    "$OOCD_BIN/oocgen scene sphere --triangles 400 --seed $seed "
		    "-o models/small/s$seed.ply; done && "
		    "$OOCD_BIN/oocgen scene soup --triangles 300 -o models/soup.ply && "
		    "$OOCD_BIN/oocgen scene fence --triangles 300 -o models/fence.ply && "
		    "$OOCD_BIN/oocgen scene corridor --triangles 900 -o models/corridor.ply && "
		    "$OOCD_BIN/oocgen scene sphere --triangles 200 -o \"models/a, \\\"b\\\"/x.ply\" "
		    "&& printf 'solid none\\nendsolid none\\n' >models/empty.stl && "
		    "printf 'ply\\nformat binary_little_endian 1.0\\nelement vertex 9\\n' "
		    ">models/broken.ply",
		    folder),
		0);
}

struct placed_box {
	double low[3];
	double high[3];
	bool is_room;
};

/* The box of a placed model in the world: that of its turned box, which is the larger. */
static struct placed_box placed_box(const struct import_input *input,
				    const struct rack_model *model)
{
	struct placed_box box;

	for (int row = 0; row < 3; row++) {
		const double *m = &input->placement[4 * row];
		double middle = m[3], half = 0;

		for (int k = 0; k < 3; k++) {
			middle += m[k] * (model->low[k] + model->high[k]) / 2;
			half += fabs(m[k]) * (model->high[k] - model->low[k]) / 2;
		}
		box.low[row] = middle - half;
		box.high[row] = middle + half;
	}
	box.is_room = strstr(input->path, "/room-") != NULL;
	return box;
}

/* Reads a list and all that it names.  Returns: how many placed models, which do not overlap. */
static size_t judge_list(const char *folder, const char *path)
{
	char *arguments[] = { (char *)path };
	struct import_inputs inputs;
	struct rack_model *models;
	struct placed_box *boxes;
	size_t placed_count = 0;
	struct why why;

	if (import_inputs_expand(arguments, 1, &inputs, &why) < 0)
		fail_msg("%s", why.text);
	models = calloc(inputs.input_count, sizeof(*models));
	boxes = calloc(inputs.input_count, sizeof(*boxes));
	assert_true(models && boxes);
	assert_int_equal(rack_read(&inputs, models, folder, 2, &why), 0);
	for (size_t i = 0; i < inputs.input_count; i++) {
		assert_int_equal(models[i].error, 0);
		boxes[i] = placed_box(&inputs.inputs[i], &models[i]);
		placed_count += !boxes[i].is_room;
		for (size_t j = 0; j < i && !boxes[i].is_room; j++) {
			bool apart = boxes[j].is_room;

			for (int k = 0; k < 3; k++)
				apart |= boxes[i].low[k] >= boxes[j].high[k] ||
					 boxes[j].low[k] >= boxes[i].high[k];
			assert_true(apart);
		}
	}
	free(models);
	free(boxes);
	import_inputs_done(&inputs);
	return placed_count;
}

static void a_rack_is_a_list_of_models_that_do_not_overlap(void **state)
{
	const char *folder = *state;
	const char *list = test_path(folder, "rack.csv");

	make_models(folder);
	assert_run(RUN("$OOCD_BIN/oocgen rack %s/models -o %s --json", folder, list),
		   "{\"models\": 10, \"empty\": 1, \"unreadable\": 1, \"placed\": 8, ");
	assert_non_null(strstr(output, "broken.ply"));
	assert_int_equal(judge_list(folder, list), 8);
	assert_run(RUN("$OOCD_BIN/oocgen rack %s/models -o %s --copies 30 --json", folder, list),
		   "\"placed\": 240, ");
	assert_int_equal(judge_list(folder, list), 240);
	/* Fewer models again: the rooms that nobody names any more are gone. */
	assert_run(RUN("cd %s && $OOCD_BIN/oocgen rack models/small -o rack.csv && "
		       "test $(ls rack.d/*.obj | wc -l) = $(grep -c room- rack.csv) && ls",
		       folder),
		   "rack.d");
	/* Nothing of the work is left. */
	assert_string_equal(test_folder_list(folder), "models rack.csv rack.d ");
}

/* The names and colours of a model's parts, as import says them. */
static int note_part(void *arg, const struct import_part *part, struct why *why)
{
	char *seen = arg;
	size_t length = strlen(seen);

	(void)why;
	(void)snprintf(seen + length, 1024 - length, "%s|%s|%d\n", part->name, part->material,
		       part->colour != IMPORT_COLOUR_DEFAULT);
	return 0;
}

static int pass_batch(void *arg, const struct import_batch *batch, struct why *why)
{
	(void)arg;
	(void)why;
	assert_null(batch->colours);
	return 0;
}

static void a_room_is_a_model_of_parts_with_materials(void **state)
{
	const char *folder = *state;
	char seen[1024] = "";
	const struct import_options options = { .memory_bytes = 64 * MIB,
						.scratch_directory = folder };
	const struct import_sink sink = { .part = note_part, .batch = pass_batch, .arg = seen };
	struct import_info info;
	struct why why;

	make_models(folder);
	assert_int_equal(RUN("cd %s && $OOCD_BIN/oocgen rack models -o r.csv", folder), 0);
	if (import_file(test_path(folder, "r.d/room-0000.obj"), &options, &sink, &info, &why) < 0)
		fail_msg("%s", why.text);
	assert_false(info.missing_material_file);
	assert_non_null(strstr(seen, "room 0 / floor|floor|1\n"));
	assert_non_null(strstr(seen, "room 0 / wall|wall|1\n"));
	assert_non_null(strstr(seen, "room 0 / panel|panel|1\n"));
	assert_non_null(strstr(seen, "room 0 / shelf|shelf|1\n"));
}

static void a_rack_depends_on_its_seed_alone(void **state)
{
	make_models(*state);
	assert_run(RUN("cd %s && mkdir one two three && "
		       "$OOCD_BIN/oocgen rack models -o one/r.csv --jobs 1 --copies 3 && "
		       "$OOCD_BIN/oocgen rack ./models/ -o two/r.csv --jobs 4 --copies 3 && "
		       "$OOCD_BIN/oocgen rack models -o three/r.csv --seed 2 --copies 3 && "
		       "diff -r one two && ! cmp -s one/r.csv three/r.csv && echo same",
		       (const char *)*state),
		   "same");
}

static void a_rack_turns_models_upright(void **state)
{
	const char *folder = *state;
	const char *list = test_path(folder, "rack.csv");

	make_models(folder);
	/* Model y is world z: the third row of each placed matrix says 0, 1, 0. */
	assert_run(RUN("$OOCD_BIN/oocgen rack --up y %s/models/small -o %s && "
		       "grep -v room- %s | tail -n +2 | cut -d, -f10-12 | sort -u",
		       folder, list, list),
		   "\n0,1,0\n");
	assert_int_equal(judge_list(folder, list), 4);
	assert_run(RUN("$OOCD_BIN/oocgen rack --up x %s/models/small -o %s && "
		       "grep -v room- %s | tail -n +2 | cut -d, -f10-12 | sort -u",
		       folder, list, list),
		   "\n1,0,0\n");
	assert_int_equal(judge_list(folder, list), 4);
}

static void a_rack_that_fails_leaves_nothing(void **state)
{
	const char *folder = *state;

	make_models(folder);
	assert_int_equal(RUN("cd %s && mkdir none && $OOCD_BIN/oocgen rack none -o r.csv; s=$?; "
			     "rmdir none; exit $s",
			     folder),
			 1);
	assert_non_null(strstr(output, "nothing to place"));
	assert_int_equal(RUN("cd %s && $OOCD_BIN/oocgen rack nowhere -o r.csv", folder), 1);
	assert_int_equal(RUN("cd %s && $OOCD_BIN/oocgen rack models -o no/r.csv", folder), 1);
	assert_int_equal(RUN("cd %s && ulimit -f 2; trap '' XFSZ; "
			     "$OOCD_BIN/oocgen rack models -o r.csv",
			     folder),
			 1);
	assert_non_null(strstr(output, "cannot be written"));
	assert_string_equal(test_folder_list(folder), "models ");
	/* A list does not go into a list: its places would be lost. */
	assert_int_equal(RUN("cd %s && $OOCD_BIN/oocgen rack models -o r.csv 2>&1 && "
			     "$OOCD_BIN/oocgen rack r.csv -o again.csv",
			     folder),
			 1);
	assert_non_null(strstr(output, "placed by a scene list"));
}

#define WITH_FOLDER(test)                                                                          \
	cmocka_unit_test_setup_teardown(test, test_folder_setup, test_folder_teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {
		WITH_FOLDER(memory_does_not_grow_with_the_plant),
		WITH_FOLDER(an_interrupted_plant_leaves_no_file),
		WITH_FOLDER(standard_output_gets_the_same_bytes),
		WITH_FOLDER(a_full_disk_leaves_what_was_there),
		WITH_FOLDER(wrong_usage_is_told_in_one_line),
		WITH_FOLDER(a_rack_is_a_list_of_models_that_do_not_overlap),
		WITH_FOLDER(a_room_is_a_model_of_parts_with_materials),
		WITH_FOLDER(a_rack_depends_on_its_seed_alone),
		WITH_FOLDER(a_rack_turns_models_upright),
		WITH_FOLDER(a_rack_that_fails_leaves_nothing),
	};

	return TEST_RUN(tests);
}
