/* SPDX-License-Identifier: MIT */
/**
 * chart_report.h - a chart as a folder: report.html, which stands alone, CSV tables, and the front.
 *
 * Threads: the main thread.
 */
#ifndef TOOLS_BENCH_ACCURACY_CHART_REPORT_H
#define TOOLS_BENCH_ACCURACY_CHART_REPORT_H

#include "tools/bench/accuracy/chart.h"
#include "tools/bench/base/page.h"

/** The cheapest setting that is right enough; setting_count: none is. */
size_t chart_knee(const struct chart *chart, double error_max);

/**
 * Writes a scene's part of the page, and FOLDER/NAME.csv with all of its figures.
 *
 * name:       of the scene's files.
 * error_max:  for the knee, share of covered pixels.
 *
 * Returns: 0 or what went wrong.
 */
int chart_report(const struct chart *chart, struct page *page, const char *folder, const char *name,
		 double error_max, struct why *why);

#endif /* TOOLS_BENCH_ACCURACY_CHART_REPORT_H */
