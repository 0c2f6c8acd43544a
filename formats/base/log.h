/* SPDX-License-Identifier: MIT */
/**
 * log.h - what a program says on standard error.
 *
 * Whoever handles a failure logs it, once.  Lines are "program: text"; where standard error is the
 * journal, they carry the syslog level as "<N>" in front.  Library code returns and does not log.
 *
 * Threads: any.
 */
#ifndef FORMATS_BASE_LOG_H
#define FORMATS_BASE_LOG_H

#include <stdbool.h>
#include <stddef.h>

enum log_level {
	LOG_LEVEL_ERROR = 3,
	LOG_LEVEL_WARNING = 4,
	LOG_LEVEL_INFO = 6,
	LOG_LEVEL_DEBUG = 7,
};

/** Sets the name in front of each line and what is shown.  Call once, first thing in main(). */
void log_init(const char *program, enum log_level level_max);

/** One line; no newline at the end. */
void log_write(enum log_level level, const char *format, ...) __attribute__((format(printf, 2, 3)));

/** What a line is about, for whoever looks for it in the journal: "OOCD_STORE", "/srv/plant.ooc". */
struct log_field {
	const char *name;
	const char *value;
};

/** The same; where standard error is the journal, with fields. */
void log_write_about(enum log_level level, const struct log_field *fields, size_t field_count,
		     const char *format, ...) __attribute__((format(printf, 4, 5)));

/** The name given to log_init(), for usage texts. */
const char *log_program(void);

#define log_error(...)   log_write(LOG_LEVEL_ERROR, __VA_ARGS__)
#define log_warning(...) log_write(LOG_LEVEL_WARNING, __VA_ARGS__)
#define log_info(...)    log_write(LOG_LEVEL_INFO, __VA_ARGS__)
#define log_debug(...)   log_write(LOG_LEVEL_DEBUG, __VA_ARGS__)

#endif /* FORMATS_BASE_LOG_H */
