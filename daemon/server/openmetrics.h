/* SPDX-License-Identifier: MIT */
/**
 * openmetrics.h - writes metrics as OpenMetrics text.
 *
 * A family is its head and then its samples; nothing of another family between them.  Whoever writes
 * ends with openmetrics_end().
 *
 * Threads: one at a time.
 * Source: OpenMetrics, text format, version 1.0.0.
 */
#ifndef DAEMON_SERVER_OPENMETRICS_H
#define DAEMON_SERVER_OPENMETRICS_H

#include <stdint.h>
#include <stdio.h>

#include "formats/base/histogram.h"

enum openmetrics_type {
	OPENMETRICS_COUNTER,
	OPENMETRICS_GAUGE,
	OPENMETRICS_HISTOGRAM,
	OPENMETRICS_INFO,
};

/**
 * The head of a family.  A name that ends in _bytes, _seconds or _ratio has that unit.
 *
 * help:  one line without backslashes and quotes.
 */
void openmetrics_family(FILE *out, const char *name, enum openmetrics_type type, const char *help);

/** A counter's sample; label and value: both or neither. */
void openmetrics_count(FILE *out, const char *name, const char *label, const char *value,
		       uint64_t count);

/** A gauge's sample. */
void openmetrics_gauge(FILE *out, const char *name, double gauge);

/** A histogram's samples, in seconds; label and value: both or neither. */
void openmetrics_histogram(FILE *out, const char *name, const char *label, const char *value,
			   const struct histogram *histogram);

void openmetrics_end(FILE *out);

#endif /* DAEMON_SERVER_OPENMETRICS_H */
