/* SPDX-License-Identifier: MIT */
#include "viewer/cost_model.h"

#include <errno.h>
#include <inttypes.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <xxhash.h>

#include "formats/base/bytes.h"
#include "formats/base/text.h"

#define NS_A_MS 1e6

/* Goes up when what is measured, or how, changes. */
static const char file_magic[] = "oocview cost 1";

#define LINE_BYTES 512

/* A figure above it was not measured by this program: an hour a frame. */
#define FIGURE_MAX 3.6e6

static const struct {
	const char *name;
	size_t offset;
} figures[] = {
	{ "frame_ms", offsetof(struct cost_model, frame_ms) },
	{ "triangle_ns", offsetof(struct cost_model, triangle_ns) },
	{ "pixel_ns", offsetof(struct cost_model, pixel_ns) },
	{ "query_ns", offsetof(struct cost_model, query_ns) },
};

static double *figure(struct cost_model *model, size_t i)
{
	return (double *)(void *)((char *)model + figures[i].offset);
}

double cost_model_frame_ms(const struct cost_model *model, double triangles, double pixels)
{
	return model->frame_ms +
	       (triangles * model->triangle_ns + pixels * model->pixel_ns) / NS_A_MS;
}

const char *cost_model_path(const char *folder, const struct cost_identity *identity, char *buffer,
			    size_t buffer_bytes)
{
	(void)snprintf(buffer, buffer_bytes, "%s/renderer-%016" PRIx64 ".cost", folder,
		       XXH3_64bits(identity->renderer, strlen(identity->renderer)));
	return buffer;
}

/* Reads a line without its newline.  Returns: 0 or -EUCLEAN. */
static int read_line(FILE *file, char line[LINE_BYTES])
{
	size_t length;

	if (!fgets(line, LINE_BYTES, file))
		return -EUCLEAN;
	length = strlen(line);
	if (length == 0 || line[length - 1] != '\n')
		return -EUCLEAN;
	line[length - 1] = '\0';
	return 0;
}

/* Is the next line "key value", and is the value this one? */
static int expect_line(FILE *file, const char *expected)
{
	char line[LINE_BYTES];

	if (read_line(file, line) < 0)
		return -EUCLEAN;
	return strcmp(line, expected) == 0 ? 0 : -ESTALE;
}

static int expect_text(FILE *file, const char *key, const char *value)
{
	char expected[LINE_BYTES];

	(void)snprintf(expected, sizeof(expected), "%s %s", key, value);
	return expect_line(file, expected);
}

static int read_figure(FILE *file, const char *name, double *ret)
{
	char line[LINE_BYTES];
	size_t length = strlen(name);

	if (read_line(file, line) < 0 || strncmp(line, name, length) != 0 || line[length] != ' ')
		return -EUCLEAN;
	if (text_to_double(line + length + 1, ret) < 0 || !(*ret >= 0.0 && *ret <= FIGURE_MAX))
		return -EUCLEAN;
	return 0;
}

int cost_model_read(const char *path, const struct cost_identity *identity, struct cost_model *ret,
		    struct why *why)
{
	FILE *file = fopen(path, "re");
	struct cost_model model;
	int r;

	if (!file)
		return why_errno(why, -errno, "%s", path);
	r = expect_line(file, file_magic);
	if (r == 0)
		r = expect_text(file, "renderer", identity->renderer);
	if (r == 0)
		r = expect_text(file, "version", identity->version);
	for (size_t i = 0; i < ARRAY_LENGTH(figures) && r == 0; i++)
		r = read_figure(file, figures[i].name, figure(&model, i));
	(void)fclose(file);
	if (r == -ESTALE)
		return why_set(why, r, "%s: measured with another driver", path);
	if (r < 0)
		return why_set(why, r, "%s: this is not what was measured", path);
	*ret = model;
	return 0;
}

int cost_model_write(const char *path, const struct cost_identity *identity,
		     const struct cost_model *model, struct why *why)
{
	struct cost_model copy = *model;
	char part_path[PATH_MAX];
	FILE *file;
	int r = 0;

	(void)snprintf(part_path, sizeof(part_path), "%s.%d", path, (int)getpid());
	file = fopen(part_path, "we");
	if (!file)
		return why_errno(why, -errno, "%s", part_path);
	(void)fprintf(file, "%s\nrenderer %s\nversion %s\n", file_magic, identity->renderer,
		      identity->version);
	for (size_t i = 0; i < ARRAY_LENGTH(figures); i++)
		(void)fprintf(file, "%s %.6g\n", figures[i].name, *figure(&copy, i));
	if (ferror(file))
		r = -EIO;
	if (fclose(file) != 0 && r == 0)
		r = -errno;
	if (r == 0 && rename(part_path, path) < 0)
		r = -errno;
	if (r < 0) {
		(void)unlink(part_path);
		return why_errno(why, r, "%s", path);
	}
	return 0;
}
