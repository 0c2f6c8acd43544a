/* SPDX-License-Identifier: MIT */
/**
 * measure.h - what the verbs of oocbench share: other programs run and timed, a daemon of their own,
 * a folder for scratch.
 *
 * Threads: the main thread.
 */
#ifndef TOOLS_BENCH_BASE_MEASURE_H
#define TOOLS_BENCH_BASE_MEASURE_H

#include <limits.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <sys/types.h>

#include "formats/base/why.h"

/* ---- other programs ---- */

/** Path of one of our programs: beside this one, else its name, to be found by PATH. */
void measure_program(const char *name, char ret[PATH_MAX]);

/** Can a program be found by PATH? */
bool measure_has_program(const char *name);

struct measure_child {
	pid_t pid;
	int output_fd;
	uint64_t begin_ns;
};

struct measure_result {
	double seconds;     /* from start to end, wall clock */
	double cpu_seconds; /* user and system, of the program and those it waited for */
	uint64_t peak_rss_bytes;
	char *output; /* its standard output, NUL-terminated */
};

/**
 * Starts a program by path or name; standard output is kept, standard error is ours.  It gets
 * SIGTERM when we die.
 *
 * argv:  NULL-terminated.
 *
 * Returns: 0, -ENOENT or -errno.
 */
int measure_start(const char *const *argv, struct measure_child *ret, struct why *why);

/**
 * Waits until it ends.
 *
 * Returns: 0, -ECHILD when it failed (by status or signal), -ENOMEM when it said too much, -ECANCELED
 *	when we were interrupted.
 * Ownership: *ret ends with measure_result_done() on success.
 */
int measure_finish(struct measure_child *child, struct measure_result *ret, struct why *why);
void measure_result_done(struct measure_result *result);

/** Starts and waits. */
int measure_run(const char *const *argv, struct measure_result *ret, struct why *why);

/** Stops a program that would run on (SIGTERM) and waits for it. */
void measure_stop(struct measure_child *child);

/** Number behind "key": in JSON text; for flat objects.  Returns: 0 or -ENOENT. */
int measure_json_number(const char *json, const char *key, double *ret);

/** From now on SIGINT and SIGTERM end waits with -ECANCELED, so that scratch is removed. */
void measure_catch_signals(void);
bool measure_was_cancelled(void);

/* ---- our daemon ---- */

/** A daemon of our own, on a socket in the scratch folder. */
struct measure_daemon {
	struct measure_child child;
	char socket_path[PATH_MAX];
};

#define MEASURE_DAEMON_OPTION_COUNT_MAX 24u

/**
 * Starts it and waits until it answers.
 *
 * options:  its command line but for --socket, NULL-terminated; at most
 *           MEASURE_DAEMON_OPTION_COUNT_MAX.
 *
 * Returns: 0, -ETIMEDOUT, -ECHILD (it has ended), -ECANCELED or what starting said.
 */
int measure_daemon_start_with(const char *scratch, const char *const *options,
			      struct measure_daemon *ret, struct why *why);
/** queue_depth:  0: the daemon's own. */
int measure_daemon_start(const char *scratch, uint64_t cache_bytes, unsigned queue_depth,
			 struct measure_daemon *ret, struct why *why);
void measure_daemon_stop(struct measure_daemon *daemon);

/** Seconds of CPU that a process has used.  Returns: 0 or -errno. */
int measure_cpu_seconds(pid_t pid, double *ret);

/* ---- scratch ---- */

/** Makes a folder below `parent` (NULL: $TMPDIR or /var/tmp). Returns: 0 or -errno. */
int measure_scratch_make(const char *parent, char ret[PATH_MAX], struct why *why);
void measure_scratch_remove(const char *folder);

#endif /* TOOLS_BENCH_BASE_MEASURE_H */
