/* SPDX-License-Identifier: MIT */
/**
 * bench.h - the verbs of oocbench.  One file a verb; main.c has the table.
 *
 * A verb gets its own command line (argv[0] is the verb), says what is wrong with it, and prints its
 * results.
 *
 * Returns of verbs: 0, 1 failed, 2 wrong usage; the exit status of the program.
 */
#ifndef TOOLS_BENCH_BENCH_H
#define TOOLS_BENCH_BENCH_H

int verb_build(int argc, char **argv);
int verb_cache(int argc, char **argv);
int verb_chart(int argc, char **argv);
int verb_exact(int argc, char **argv);
int verb_fetch(int argc, char **argv);
int verb_path(int argc, char **argv);
int verb_record(int argc, char **argv);
int verb_replay(int argc, char **argv);
int verb_select(int argc, char **argv);
int verb_soak(int argc, char **argv);
int verb_stress(int argc, char **argv);
int verb_walk(int argc, char **argv);

#endif /* TOOLS_BENCH_BENCH_H */
