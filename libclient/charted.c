/* SPDX-License-Identifier: MIT */
#include "libclient/charted.h"

#include <errno.h>
#include <limits.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "formats/base/cache_folder.h"
#include "formats/base/text.h"
#include "formats/store/new_file.h"

#define HEADER    "error,ms,options"
#define ROW_BYTES 256u

static int chart_path(const uint8_t uuid[16], char path[PATH_MAX], struct why *why)
{
	char folder[PATH_MAX];
	char name[33];
	int r = cache_folder_make(folder, why);

	if (r < 0)
		return r;
	for (unsigned i = 0; i < 16; i++)
		(void)snprintf(name + 2 * (size_t)i, 3, "%02x", uuid[i]);
	if (snprintf(path, PATH_MAX, "%s/chart-%s.csv", folder, name) >= PATH_MAX)
		return why_set(why, -ENAMETOOLONG, "%s: too long a name", folder);
	return 0;
}

static int rows_write(struct new_file *file, const struct charted *charted, size_t count)
{
	/* Closing it shall not close the new file. */
	FILE *out = fdopen(dup(new_file_fd(file)), "w");
	bool failed;

	if (!out)
		return -errno;
	fprintf(out, "%s\n", HEADER);
	for (size_t i = 0; i < count; i++)
		fprintf(out, "%.9g,%.9g,%s\n", charted[i].error, charted[i].ms, charted[i].options);
	failed = ferror(out) != 0;
	return fclose(out) != 0 || failed ? -EIO : 0;
}

int charted_write(const uint8_t uuid[16], const struct charted *charted, size_t count,
		  struct why *why)
{
	struct new_file *file;
	char path[PATH_MAX];
	int r = chart_path(uuid, path, why);

	if (r < 0)
		return r;
	r = new_file_create(path, &file, why);
	if (r < 0)
		return r;
	r = rows_write(file, charted, count);
	if (r < 0)
		r = why_errno(why, r, "%s", path);
	else
		r = new_file_commit(file, why);
	new_file_destroy(file);
	return r;
}

/* A row of ours, or not. */
static bool row_parse(char *row, struct charted *ret)
{
	char *error = strsep(&row, ",");
	char *ms = strsep(&row, ",");

	if (!row || strchr(row, ',') || strlen(row) >= sizeof(ret->options))
		return false;
	if (text_to_double(error, &ret->error) < 0 || text_to_double(ms, &ret->ms) < 0)
		return false;
	strcpy(ret->options, row);
	return ret->error >= 0.0 && ret->ms >= 0.0;
}

static int rows_read(FILE *in, double error_max, struct charted *ret)
{
	char row[ROW_BYTES];
	bool found = false;

	if (!fgets(row, sizeof(row), in) || strcmp(row, HEADER "\n") != 0)
		return -EUCLEAN;
	for (unsigned i = 0; i < CHARTED_COUNT_MAX && fgets(row, sizeof(row), in); i++) {
		struct charted charted;

		row[strcspn(row, "\n")] = '\0';
		if (!row_parse(row, &charted))
			return -EUCLEAN;
		if (charted.error > error_max || (found && charted.ms >= ret->ms))
			continue;
		*ret = charted;
		found = true;
	}
	return found ? 0 : -ERANGE;
}

int charted_find(const uint8_t uuid[16], double error_max, struct charted *ret, struct why *why)
{
	struct charted charted;
	char path[PATH_MAX];
	FILE *in;
	int r = chart_path(uuid, path, why);

	if (r < 0)
		return r;
	in = fopen(path, "re");
	if (!in && errno == ENOENT)
		return why_set(why, -ENOENT,
			       "it was never charted: run `oocbench chart STORE -o FOLDER` once");
	if (!in)
		return why_errno(why, -errno, "%s", path);
	r = rows_read(in, error_max, &charted);
	(void)fclose(in);
	if (r == -EUCLEAN)
		return why_set(why, r, "%s: not a chart: remove it and chart the store again",
			       path);
	if (r == -ERANGE)
		return why_set(why, r, "no way of drawing it was charted to be so right");
	*ret = charted;
	return 0;
}
