/* SPDX-License-Identifier: MIT */
#include "tools/bench/contest/viewers.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "formats/base/bytes.h"
#include "tools/bench/base/measure.h"

/* Adds up lines of /proc/PID/smaps_rollup that begin so. */
static int read_rollup(pid_t pid, const char *key, double *ret)
{
	char path[64];
	char line[256];
	double bytes = 0.0;
	bool is_found = false;
	FILE *file;

	(void)snprintf(path, sizeof(path), "/proc/%d/smaps_rollup", (int)pid);
	file = fopen(path, "re");
	if (!file)
		return -errno;
	while (fgets(line, sizeof(line), file)) {
		const char *at = strchr(line, ':');
		double kib;

		if (!at || strncmp(line, key, strlen(key)) != 0 || sscanf(at, ": %lf", &kib) != 1)
			continue;
		bytes += kib * (double)KIB;
		is_found = true;
	}
	(void)fclose(file);
	if (!is_found)
		return -ENODATA;
	*ret = bytes;
	return 0;
}

static int viewer_start(const struct viewers_config *config, struct measure_child *ret,
			struct why *why)
{
	char program[PATH_MAX];
	const char *argv[] = { program,       "--headless",  "--size",
			       "640x480",     "--socket",    config->socket_path,
			       "--path",      config->path,  "--repeat",
			       "1000000",     config->store, config->is_control ? "--mode" : NULL,
			       "approximate", "--budget",    "1",
			       NULL };

	measure_program("oocview", program);
	return measure_start(argv, ret, why);
}

static int wait_seconds(unsigned seconds, struct why *why)
{
	struct timespec left = { .tv_sec = (time_t)seconds };

	while (nanosleep(&left, &left) < 0)
		if (measure_was_cancelled())
			return why_set(why, -ECANCELED, "interrupted");
	return 0;
}

int viewers_measure(const struct viewers_config *config, struct viewers_memory *ret,
		    struct why *why)
{
	struct measure_child children[VIEWERS_COUNT_MAX];
	unsigned started_count = 0;
	int r = 0;

	*ret = (struct viewers_memory){ 0 };
	if (config->is_single)
		(void)setenv("LP_NUM_THREADS", "0", 1);
	for (; r == 0 && started_count < config->viewer_count; started_count++) {
		r = viewer_start(config, &children[started_count], why);
		if (r < 0)
			break;
	}
	if (config->is_single)
		(void)unsetenv("LP_NUM_THREADS");
	if (r == 0)
		r = wait_seconds(config->seconds, why);
	for (unsigned i = 0; r == 0 && i < started_count; i++) {
		double all_bytes = 0.0;

		r = read_rollup(children[i].pid, "Private_", &ret->private_bytes[i]);
		if (r == 0)
			r = read_rollup(children[i].pid, "Pss:", &all_bytes);
		if (r < 0)
			r = why_set(why, -ECHILD, "a viewer has ended");
		ret->all_bytes += all_bytes;
	}
	for (unsigned i = 0; i < started_count; i++)
		measure_stop(&children[i]);
	return r;
}
