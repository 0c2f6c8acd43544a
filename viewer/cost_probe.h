/* SPDX-License-Identifier: MIT */
/**
 * cost_probe.h - measures what drawing costs here, once for each driver.
 *
 * Threads: the GL thread.
 */
#ifndef VIEWER_COST_PROBE_H
#define VIEWER_COST_PROBE_H

#include "formats/base/why.h"
#include "viewer/cost_model.h"
#include "viewer/renderer.h"

/**
 * The costs of the current context's renderer: as the user's cache folder has them, else measured in
 * about a second and kept there.  Where they cannot be kept that is told, and they are measured again
 * the next time.
 *
 * Returns: 0 or -ENOMEM.
 */
int cost_probe_get(struct renderer *renderer, struct cost_model *ret, struct why *why);

#endif /* VIEWER_COST_PROBE_H */
