/* SPDX-License-Identifier: MIT */
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "tests/helper.h"
#include "tests/integration/view_kit.h"

char view_output[VIEW_OUTPUT_BYTES];

int view_setup(void **state)
{
	struct view_fixture *fixture = calloc(1, sizeof(*fixture));

	assert_non_null(fixture);
	fixture->folder = test_folder_make();
	*state = fixture;
	return 0;
}

int view_teardown(void **state)
{
	struct view_fixture *fixture = *state;

	if (fixture->daemon.pid > 0)
		assert_int_equal(kit_daemon_stop(&fixture->daemon, SIGTERM), 0);
	test_folder_remove(fixture->folder);
	free(fixture);
	return 0;
}

void view_start_daemon(struct view_fixture *fixture, uint64_t cache_bytes)
{
	struct server_config config = kit_config();

	if (fixture->daemon.pid > 0)
		assert_int_equal(kit_daemon_stop(&fixture->daemon, SIGTERM), 0);
	config.cache_bytes = cache_bytes;
	kit_daemon_start(fixture->folder, &config, &fixture->daemon);
}

int view_run(const struct view_fixture *fixture, const char *format, ...)
{
	char arguments[2048];
	va_list args;

	va_start(args, format);
	(void)vsnprintf(arguments, sizeof(arguments), format, args);
	va_end(args);
	return test_command(view_output, sizeof(view_output),
			    "cd %s && exec $OOCD_BIN/oocview --socket %s/oocd.sock %s",
			    fixture->folder, fixture->folder, arguments);
}

void view_must(int status)
{
	if (status != 0)
		fail_msg("oocview ended with %d: %s", status, view_output);
}

const char *view_file(const struct view_fixture *fixture, const char *name)
{
	return test_path(fixture->folder, name);
}

struct view_image view_load_raw(const char *path)
{
	struct view_image image;
	size_t bytes;

	image.file = test_file_read(path, &bytes);
	assert_true(bytes > sizeof(image.header));
	memcpy(&image.header, image.file, sizeof(image.header));
	assert_int_equal(bytes, sizeof(image.header) + (size_t)image.header.width *
							       image.header.height *
							       image.header.pixel_bytes);
	image.items = (const void *)((const uint8_t *)image.file + sizeof(image.header));
	image.reals = (const void *)image.items;
	return image;
}

double view_summary_number(const char *key)
{
	char quoted[64];
	const char *at;

	(void)snprintf(quoted, sizeof(quoted), "\"%s\":", key);
	at = strstr(view_output, quoted);
	if (!at)
		fail_msg("no %s in %s", key, view_output);
	return strtod(at + strlen(quoted), NULL);
}

void view_write_path(const struct view_fixture *fixture, const char *name, uint32_t rows)
{
	FILE *file = fopen(view_file(fixture, name), "we");

	assert_non_null(file);
	(void)fprintf(file, "t,eye_x,eye_y,eye_z,at_x,at_y,at_z,up_x,up_y,up_z,fov_y\n");
	for (uint32_t i = 0; i < rows; i++)
		(void)fprintf(file, "%g,%g,188,309,103,203,303,0,0,1,45\n", 0.1 * i, 92.0 + i);
	(void)fclose(file);
}
