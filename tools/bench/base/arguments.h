/* SPDX-License-Identifier: MIT */
/**
 * arguments.h - a verb's command line, from a table that says what goes where.
 *
 * --help is understood by itself.  What is wrong is said in one line that names the option, what was
 * given, and what would do.
 *
 * Threads: the main thread.
 */
#ifndef TOOLS_BENCH_BASE_ARGUMENTS_H
#define TOOLS_BENCH_BASE_ARGUMENTS_H

#include <stdint.h>

enum argument_kind {
	ARGUMENT_FLAG,    /* bool: given or not */
	ARGUMENT_NUMBER,  /* uint64_t, min .. max */
	ARGUMENT_SIZE,    /* uint64_t bytes, as 256M, min .. max */
	ARGUMENT_REAL,    /* double, min .. max */
	ARGUMENT_TEXT,    /* const char * */
	ARGUMENT_CHOICE,  /* unsigned: index in choices */
	ARGUMENT_PICTURE, /* unsigned[2]: width and height, as 640x480, min .. max each */
};

struct argument {
	const char *name; /* without the dashes */
	enum argument_kind kind;
	void *value; /* of the type that the kind says; holds what is usual before */
	double min;
	double max;                 /* 0: no bound */
	const char *const *choices; /* NULL-terminated */
	char letter;                /* of the short form; 0: none */
};

#define ARGUMENT_COUNT_MAX 32u

struct arguments {
	const char *verb;
	const char *help;
	const struct argument *table; /* ends with an entry without a name */
	int operand_min;
	int operand_max;           /* of what is not an option; -1: no bound */
	const char *operand_usage; /* said when there are too few or too many: "name one store" */
};

/** To go on; everything else is the exit status. */
#define ARGUMENTS_OK (-1)

/**
 * Takes a command line apart; argv[0] is the verb.
 *
 * ret_operands:  the operands, NULL-terminated, inside argv.
 *
 * Returns: ARGUMENTS_OK, 0 (help was asked for and given) or 2 (wrong usage, said).
 */
int arguments_parse(const struct arguments *arguments, int argc, char **argv, char ***ret_operands);

#endif /* TOOLS_BENCH_BASE_ARGUMENTS_H */
