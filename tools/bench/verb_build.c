/* SPDX-License-Identifier: MIT */
/*
 * oocbench build: how fast oocbuild is, beside what the disk takes to read the input and write the
 * output (the floor), in turn, in one run.
 */
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "formats/base/bytes.h"
#include "formats/base/clock.h"
#include "formats/base/file.h"
#include "formats/base/text.h"
#include "tools/bench/base/arguments.h"
#include "tools/bench/base/figures.h"
#include "tools/bench/base/measure.h"
#include "tools/bench/base/report.h"
#include "tools/bench/base/verb.h"
#include "tools/bench/bench.h"

#define REPEATS_MAX 1000u
/** Reads and writes of the floor. */
#define FLOOR_BYTES (4u << 20)

static const char help[] =
	"Usage: oocbench build [MODEL] [--triangles N] [--seed S] [--memory SIZE] [--jobs N]\n"
	"                      [--repeats N] [--folder DIR]\n"
	"Measures oocbuild on a model, or on a plant that oocgen makes, against the floor: an O_DIRECT\n"
	"read of the input, and a write and fdatasync of the output's size.\n"
	"\n"
	"  --triangles N   of the plant (13000000)\n"
	"  --seed S        of the plant (1)\n"
	"  --memory SIZE   bound for oocbuild (512M)\n"
	"  --jobs N        of oocbuild (its own choice)\n"
	"  --repeats N     measurements of each (5)\n"
	"  --folder DIR    on the disk to measure ($TMPDIR or /var/tmp)\n"
	"  --json          results for programs\n"
	"\n"
	"Example:\n"
	"  oocbench build --triangles 1000000 --memory 256M\n";

struct build_options {
	const char *model; /* NULL: a plant */
	const char *folder;
	uint64_t triangle_count;
	uint64_t seed;
	uint64_t memory_bytes;
	uint64_t job_count; /* 0: its own choice */
	uint64_t repeat_count;
	bool is_json;
};

struct build {
	const struct build_options *options;
	char scratch[PATH_MAX];
	char model[PATH_MAX];
	char store[PATH_MAX];
	uint64_t input_bytes;
	uint64_t output_bytes;
	double triangle_count;
	double peak_rss_bytes; /* the largest of all runs: as oocbuild and as the kernel says */
	double scratch_bytes;
	/* One figure a repeat. */
	double *build_seconds;
	double *build_cpu_seconds;
	double *floor_seconds;
	double *ratios;
};

/* ---- the floor ---- */

static int floor_read(const char *path, uint64_t size_bytes, void *buffer, struct why *why)
{
	AUTO_FD fd = open(path, O_RDONLY | O_DIRECT | O_CLOEXEC);

	if (fd < 0)
		return why_errno(why, -errno, "%s cannot be read with O_DIRECT", path);
	for (uint64_t at = 0; at < size_bytes;) {
		ssize_t got = pread(fd, buffer, FLOOR_BYTES, (off_t)at);

		if (got < 0)
			return why_errno(why, -errno, "%s", path);
		if (got == 0)
			break;
		at += (uint64_t)got;
	}
	return 0;
}

static int floor_write(const char *path, uint64_t size_bytes, const void *buffer, struct why *why)
{
	AUTO_FD fd = open(path, O_WRONLY | O_CREAT | O_TRUNC | O_DIRECT | O_CLOEXEC, 0600);
	int r = 0;

	if (fd < 0)
		return why_errno(why, -errno, "%s cannot be written with O_DIRECT", path);
	for (uint64_t at = 0; r == 0 && at < size_bytes; at += FLOOR_BYTES)
		r = file_write_at(fd, buffer, FLOOR_BYTES, at);
	if (r == 0 && fdatasync(fd) < 0)
		r = -errno;
	(void)unlink(path);
	return r < 0 ? why_errno(why, r, "%s", path) : 0;
}

static int floor_run(const struct build *build, double *ret_seconds, struct why *why)
{
	char path[PATH_MAX + 16];
	uint64_t begin_ns;
	void *buffer;
	int r;

	if (posix_memalign(&buffer, 4096, FLOOR_BYTES) != 0)
		return why_set(why, -ENOMEM, "out of memory");
	/* Not zeros, which a disk may not write at all. */
	for (size_t i = 0; i < FLOOR_BYTES; i++)
		((uint8_t *)buffer)[i] = (uint8_t)(i * 2654435761u >> 11);
	(void)snprintf(path, sizeof(path), "%s/floor", build->scratch);
	begin_ns = clock_now_ns();
	r = floor_read(build->model, build->input_bytes, buffer, why);
	if (r == 0)
		r = floor_write(path, build->output_bytes, buffer, why);
	*ret_seconds = (double)(clock_now_ns() - begin_ns) / (double)NS_PER_S;
	free(buffer);
	return r;
}

/* ---- the build ---- */

static int file_bytes(const char *path, uint64_t *ret, struct why *why)
{
	struct stat status;

	if (stat(path, &status) < 0)
		return why_errno(why, -errno, "%s", path);
	*ret = (uint64_t)status.st_size;
	return 0;
}

/* Out of the page cache, so that the build reads the disk as the floor does. */
static void forget(const char *path)
{
	AUTO_FD fd = open(path, O_RDONLY | O_CLOEXEC);

	if (fd >= 0 && fdatasync(fd) == 0)
		(void)posix_fadvise(fd, 0, 0, POSIX_FADV_DONTNEED);
}

static int build_judge(struct build *build, const struct measure_result *result, struct why *why)
{
	double said_rss;
	double scratch_bytes = 0.0;

	if (measure_json_number(result->output, "triangles_in", &build->triangle_count) < 0 ||
	    measure_json_number(result->output, "peak_rss_bytes", &said_rss) < 0)
		return why_set(why, -EPROTO, "oocbuild --json does not say what is needed");
	(void)measure_json_number(result->output, "scratch_bytes", &scratch_bytes);
	if (said_rss > build->peak_rss_bytes)
		build->peak_rss_bytes = said_rss;
	if ((double)result->peak_rss_bytes > build->peak_rss_bytes)
		build->peak_rss_bytes = (double)result->peak_rss_bytes;
	if (scratch_bytes > build->scratch_bytes)
		build->scratch_bytes = scratch_bytes;
	return file_bytes(build->store, &build->output_bytes, why);
}

static int build_run(struct build *build, uint64_t repeat, struct why *why)
{
	char program[PATH_MAX];
	char memory[32];
	char jobs[32];
	const char *argv[] = { program,      "--json",     "--memory", memory, "-o",
			       build->store, build->model, NULL,       NULL,   NULL };
	struct measure_result result;
	int r;

	measure_program("oocbuild", program);
	(void)snprintf(memory, sizeof(memory), "%" PRIu64, build->options->memory_bytes);
	if (build->options->job_count > 0) {
		(void)snprintf(jobs, sizeof(jobs), "%" PRIu64, build->options->job_count);
		argv[7] = "--jobs";
		argv[8] = jobs;
	}
	forget(build->model);
	r = measure_run(argv, &result, why);
	if (r < 0)
		return r;
	build->build_seconds[repeat] = result.seconds;
	build->build_cpu_seconds[repeat] = result.cpu_seconds;
	r = build_judge(build, &result, why);
	measure_result_done(&result);
	(void)unlink(build->store);
	return r;
}

/* Build and floor; the floor first in odd repeats, when the output's size is known. */
static int build_repeat(struct build *build, uint64_t repeat, struct why *why)
{
	int r = 0;

	for (unsigned turn = 0; r == 0 && turn < 2; turn++)
		r = turn == repeat % 2 ? build_run(build, repeat, why)
				       : floor_run(build, &build->floor_seconds[repeat], why);
	if (r == 0)
		build->ratios[repeat] = build->build_seconds[repeat] / build->floor_seconds[repeat];
	return r;
}

static int model_make(struct build *build, struct why *why)
{
	char program[PATH_MAX];
	char triangles[32];
	char seed[32];
	const char *argv[] = { program, "plant", "--triangles", triangles, "--seed",
			       seed,    "-o",    build->model,  NULL };
	struct measure_result result;
	int r;

	if (build->options->model) {
		(void)snprintf(build->model, sizeof(build->model), "%s", build->options->model);
		return file_bytes(build->model, &build->input_bytes, why);
	}
	if (snprintf(build->model, sizeof(build->model), "%s/plant.ply", build->scratch) >=
	    (int)sizeof(build->model))
		return why_set(why, -ENAMETOOLONG, "%s: too long a path", build->scratch);
	measure_program("oocgen", program);
	(void)snprintf(triangles, sizeof(triangles), "%" PRIu64, build->options->triangle_count);
	(void)snprintf(seed, sizeof(seed), "%" PRIu64, build->options->seed);
	r = measure_run(argv, &result, why);
	if (r < 0)
		return r;
	measure_result_done(&result);
	return file_bytes(build->model, &build->input_bytes, why);
}

/* ---- the verb ---- */

static void build_report(struct build *build)
{
	const struct build_options *options = build->options;
	size_t count = options->repeat_count;
	struct spread seconds = spread_of(build->build_seconds, count);
	struct spread rates = { build->triangle_count / seconds.high / 1e6,
				build->triangle_count / seconds.median / 1e6,
				build->triangle_count / seconds.low / 1e6 };
	struct report report;

	report_begin(&report, options->is_json);
	report_text(&report, "model", "model", options->model ? options->model : "oocgen plant");
	report_number(&report, "triangles", "triangles", build->triangle_count, "");
	report_number(&report, "input_bytes", "input", (double)build->input_bytes, "bytes");
	report_number(&report, "output_bytes", "store", (double)build->output_bytes, "bytes");
	report_number(&report, "repeats", "repeats", (double)count, "");
	report_spread(&report, "seconds", "build", seconds, "s");
	report_spread(&report, "cpu_seconds", "processor time of the build",
		      spread_of(build->build_cpu_seconds, count), "s");
	report_spread(&report, "mtriangles_s", "speed", rates, "Mtriangles/s");
	report_spread(&report, "floor_seconds", "floor", spread_of(build->floor_seconds, count),
		      "s");
	report_spread(&report, "ratio", "build / floor", spread_of(build->ratios, count), "");
	report_number(&report, "memory_bound_bytes", "memory allowed",
		      (double)options->memory_bytes, "bytes");
	report_number(&report, "peak_rss_bytes", "memory at most", build->peak_rss_bytes, "bytes");
	report_number(&report, "scratch_bytes", "scratch at most", build->scratch_bytes, "bytes");
	report_text(&report, "within_bound", "within the bound",
		    build->peak_rss_bytes <= (double)options->memory_bytes ? "yes" : "no");
	report_end(&report);
}

static int build_measure(struct build *build, struct why *why)
{
	size_t count = build->options->repeat_count;
	int r = model_make(build, why);

	if (r < 0)
		return r;
	if (snprintf(build->store, sizeof(build->store), "%s/model.ooc", build->scratch) >=
	    (int)sizeof(build->store))
		return why_set(why, -ENAMETOOLONG, "%s: too long a path", build->scratch);
	build->build_seconds = calloc(count, sizeof(double));
	build->build_cpu_seconds = calloc(count, sizeof(double));
	build->floor_seconds = calloc(count, sizeof(double));
	build->ratios = calloc(count, sizeof(double));
	if (!build->build_seconds || !build->build_cpu_seconds || !build->floor_seconds ||
	    !build->ratios)
		r = why_set(why, -ENOMEM, "out of memory");
	for (uint64_t i = 0; r == 0 && i < count; i++)
		r = build_repeat(build, i, why);
	if (r == 0)
		build_report(build);
	free(build->build_seconds);
	free(build->build_cpu_seconds);
	free(build->floor_seconds);
	free(build->ratios);
	return r;
}

int verb_build(int argc, char **argv)
{
	struct build_options options = {
		.triangle_count = 13000000, .seed = 1, .memory_bytes = 512 * MIB, .repeat_count = 5
	};
	struct build build = { .options = &options };
	const struct argument table[] = {
		{ "triangles", ARGUMENT_NUMBER, &options.triangle_count },
		{ "seed", ARGUMENT_NUMBER, &options.seed },
		{ "memory", ARGUMENT_SIZE, &options.memory_bytes },
		{ "jobs", ARGUMENT_NUMBER, &options.job_count, .min = 1 },
		{ "repeats", ARGUMENT_NUMBER, &options.repeat_count, 1, REPEATS_MAX },
		{ "folder", ARGUMENT_TEXT, &options.folder },
		{ "json", ARGUMENT_FLAG, &options.is_json },
		{ NULL },
	};
	const struct arguments arguments = { "build", help, table, 0, 1, "name at most one model" };
	char **operands;
	struct why why = { "" };
	int r;

	r = arguments_parse(&arguments, argc, argv, &operands);
	if (r != ARGUMENTS_OK)
		return r;
	options.model = operands[0];
	r = measure_scratch_make(options.folder, build.scratch, &why);
	if (r == 0) {
		r = build_measure(&build, &why);
		measure_scratch_remove(build.scratch);
	}
	return verb_status("build", r, &why);
}
