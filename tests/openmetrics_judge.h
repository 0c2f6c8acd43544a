/* SPDX-License-Identifier: MIT */
/**
 * openmetrics_judge.h - is a text what OpenMetrics 1.0 allows?
 *
 * Judges what our metrics use: counters, gauges, histograms and infos, with their units and labels.
 */
#ifndef TESTS_OPENMETRICS_JUDGE_H
#define TESTS_OPENMETRICS_JUDGE_H

#include "formats/base/why.h"

/** Returns: 0, or -EINVAL with the line that is wrong and why. */
int openmetrics_judge(const char *text, struct why *why);

/** The value of the sample whose line begins so ("oocd_hits_total"); -1: there is none. */
double openmetrics_value(const char *text, const char *sample);

#endif /* TESTS_OPENMETRICS_JUDGE_H */
