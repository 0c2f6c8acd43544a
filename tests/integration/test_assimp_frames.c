/* SPDX-License-Identifier: MIT */
/*
 * Goal: whatever the process that reads by assimp says, it is checked.
 * Method: a copy of this program stands in a folder beside a script that takes the helper's place
 * and says what the test wrote down; the copy imports and prints how that went.
 */
#include <errno.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>

#include "formats/base/bytes.h"
#include "formats/import/assimp_frame.h"
#include "tests/helper.h"
#include "tests/unit/import_kit.h"

/* ---- the copy ---- */

static int run_as_copy(const char *path)
{
	struct kit_model *model = kit_import(path, NULL);

	printf("%d %zu %s\n", model->result, model->triangle_count,
	       model->result < 0 ? model->why.text : "");
	kit_model_free(model);
	return 0;
}

/* ---- the test ---- */

static void put_frame(struct kit_bytes *bytes, uint32_t kind, uint32_t number, const void *body,
		      size_t size_bytes)
{
	struct assimp_frame_header header = {
		.magic = ASSIMP_FRAME_MAGIC,
		.kind = kind,
		.number = number,
		.body_bytes = (uint32_t)size_bytes,
	};

	kit_append(bytes, &header, sizeof(header));
	kit_append(bytes, body, size_bytes);
}

struct batch_body {
	struct assimp_batch batch;
	float positions[9];
};

/* A well-formed story of one triangle; each case spoils a piece of it. */
struct story {
	struct assimp_info info;
	struct {
		struct assimp_part part;
		char texts[3];
	} part;
	struct batch_body batch;
	struct assimp_end end;
	struct {
		struct assimp_error error;
		char text[4];
	} error;
};

static const struct story good = {
	.info = { .unit_metres = 1.0, .up_axis = STORE_AXIS_Y },
	.part = { .part = { .colour = 1,
			    .name_bytes = 1,
			    .scene_path_bytes = 1,
			    .material_bytes = 1 },
		  .texts = { 'n', 'p', 'm' } },
	.batch = { .batch = { .triangle_count = 1 }, .positions = { 0, 0, 0, 1, 0, 0, 0, 1, 0 } },
	.end = { .triangle_count = 1, .part_count = 1, .face_count = 1 },
	.error = { .error = { .error = -EUCLEAN, .text_bytes = 4 },
		   .text = { 'o', 'd', '\n', 'd' } },
};

static struct kit_bytes tell(const struct story *story, bool as_error)
{
	struct kit_bytes bytes = { 0 };

	put_frame(&bytes, ASSIMP_FRAME_INFO, 0, &story->info, sizeof(story->info));
	put_frame(&bytes, ASSIMP_FRAME_PART, 1, &story->part,
		  sizeof(story->part.part) + sizeof(story->part.texts));
	put_frame(&bytes, ASSIMP_FRAME_BATCH, 2, &story->batch, sizeof(story->batch));
	if (as_error)
		put_frame(&bytes, ASSIMP_FRAME_ERROR, 3, &story->error,
			  sizeof(story->error.error) + sizeof(story->error.text));
	else
		put_frame(&bytes, ASSIMP_FRAME_END, 3, &story->end, sizeof(story->end));
	return bytes;
}

/* Lets the copy hear these bytes, and hands back the line that it prints. */
static const char *hear(const char *folder, const struct kit_bytes *bytes)
{
	static char line[1024];
	char command[512];
	FILE *pipe;

	test_file_write(test_path(folder, "frames"), bytes->data, bytes->size_bytes);
	(void)snprintf(command, sizeof(command), "%s/copy %s/model.off", folder, folder);
	pipe = popen(command, "re");
	assert_non_null(pipe);
	line[0] = '\0';
	(void)!fgets(line, sizeof(line), pipe);
	assert_int_equal(pclose(pipe), 0);
	return line;
}

static void assert_heard(const char *folder, struct kit_bytes bytes, int result, const char *words)
{
	const char *line = hear(folder, &bytes);

	if (atoi(line) != result || !strstr(line, words))
		fail_msg("the copy printed \"%s\", not %d \"%s\"", line, result, words);
	free(bytes.data);
}

static int stage_setup(void **state)
{
	size_t size_bytes;
	char script[256];
	void *program;

	if (test_folder_setup(state) < 0)
		return -1;
	program = test_file_read("/proc/self/exe", &size_bytes);
	test_file_write(test_path(*state, "copy"), program, size_bytes);
	free(program);
	(void)snprintf(script, sizeof(script), "#!/bin/sh\nexec cat '%s/frames'\n",
		       (const char *)*state);
	test_file_write(test_path(*state, "oocimport-assimp"), script, strlen(script));
	test_file_write(test_path(*state, "model.off"), "OFF\n", 4);
	return chmod(test_path(*state, "copy"), 0700) |
	       chmod(test_path(*state, "oocimport-assimp"), 0700);
}

static void a_good_story_is_believed(void **state)
{
	assert_heard(*state, tell(&good, false), 0, "0 1 ");
	assert_heard(*state, tell(&good, true), -EUCLEAN, "od d");
}

static void a_story_with_a_wrong_number_is_not_believed(void **state)
{
	struct story story;

#define SPOIL(field, value, as_error, words)                                                       \
	do {                                                                                       \
		story = good;                                                                      \
		story.field = (value);                                                             \
		assert_heard(*state, tell(&story, as_error), -EUCLEAN, words);                     \
	} while (0)
	SPOIL(info.unit_metres, NAN, false, "frame 1");
	SPOIL(info.unit_metres, -1.0, false, "frame 1");
	SPOIL(info.up_axis, 4, false, "frame 1");
	SPOIL(info.positions_double, 2, false, "frame 1");
	SPOIL(info.positions_double, 1, false, "length");
	SPOIL(part.part.name_bytes, 2, false, "a part");
	SPOIL(part.part.material_bytes, UINT32_MAX, false, "a part");
	SPOIL(part.part.scene_path_bytes, ASSIMP_TEXT_BYTES_MAX + 1, false, "a part");
	SPOIL(batch.batch.part, 1, false, "a batch");
	SPOIL(batch.batch.triangle_count, 0, false, "a batch");
	SPOIL(batch.batch.triangle_count, 2, false, "a batch");
	SPOIL(batch.batch.triangle_count, UINT32_MAX, false, "a batch");
	SPOIL(batch.batch.flags, ASSIMP_BATCH_NORMALS, false, "length");
	SPOIL(batch.batch.flags, 4, false, "a batch");
	SPOIL(end.triangle_count, 2, false, "sums");
	SPOIL(end.part_count, 0, false, "sums");
	SPOIL(error.error.error, 0, true, "an error");
	SPOIL(error.error.error, 5, true, "an error");
	SPOIL(error.error.text_bytes, 5, true, "an error");
}

static void a_wrong_header_is_not_believed(void **state)
{
	static const struct {
		size_t offset; /* in the first header */
		uint32_t value;
		const char *words;
	} cases[] = {
		{ 0, 0, "header" }, { 4, 0, "unknown kind" },     { 4, 6, "unknown kind" },
		{ 4, 2, "a part" }, { 4, 3, "a batch" },          { 4, 4, "sums" },
		{ 8, 1, "header" }, { 12, UINT32_MAX, "length" }, { 12, 0, "information" },
	};

	for (size_t i = 0; i < ARRAY_LENGTH(cases); i++) {
		struct kit_bytes bytes = tell(&good, false);

		memcpy(bytes.data + cases[i].offset, &cases[i].value, 4);
		assert_heard(*state, bytes, -EUCLEAN, cases[i].words);
	}
}

static void a_story_that_stops_anywhere_is_not_believed(void **state)
{
	size_t size_bytes = 1;

	for (size_t cut = 0; cut < size_bytes; cut += 23) {
		struct kit_bytes bytes = tell(&good, false);

		size_bytes = bytes.size_bytes;
		bytes.size_bytes = cut;
		assert_heard(*state, bytes, -EUCLEAN, "gave up");
	}
}

int main(int argc, char **argv)
{
#define STAGE_TEST(name) cmocka_unit_test_setup_teardown(name, stage_setup, test_folder_teardown)
	const struct CMUnitTest tests[] = {
		STAGE_TEST(a_good_story_is_believed),
		STAGE_TEST(a_story_with_a_wrong_number_is_not_believed),
		STAGE_TEST(a_wrong_header_is_not_believed),
		STAGE_TEST(a_story_that_stops_anywhere_is_not_believed),
	};

	if (argc == 2)
		return run_as_copy(argv[1]);
	return TEST_RUN(tests);
}
