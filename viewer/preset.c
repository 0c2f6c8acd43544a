/* SPDX-License-Identifier: MIT */
#include "viewer/preset.h"

#include <string.h>

#include "formats/base/bytes.h"

/*
 * Sources: Correa, Klosowski & Silva, "iWalk: Interactive Out-Of-Core Rendering of Large Models",
 * Princeton TR-653-02, 2002; "Visibility-Based Prefetching for Interactive Out-Of-Core Rendering",
 * PVG 2003.  Their eight fetch threads are eight reads in flight here; what verifies and decodes is
 * as many threads as their one processor had.
 */
static const struct preset presets[] = {
	{ .name = "iwalk-2002",
	  .budget_triangles = 140000,
	  .fps = 10.0,
	  .width = 1024,
	  .height = 768,
	  .prefetch_bytes = 1 * MIB,
	  .cache_bytes = 32 * MIB,
	  .daemon_options = { "--cache-size", "32M", "--queue-depth", "8", "--workers", "1" } },
	{ .name = "iwalk-2003",
	  .budget_triangles = 280000,
	  .fps = 10.0,
	  .width = 1024,
	  .height = 768,
	  .prefetch_bytes = 2 * MIB,
	  .cache_bytes = 256 * MIB,
	  .daemon_options = { "--cache-size", "256M", "--queue-depth", "8", "--workers", "1" } },
};

const struct preset *preset_find(const char *name)
{
	for (size_t i = 0; i < ARRAY_LENGTH(presets); i++) {
		if (strcmp(presets[i].name, name) == 0)
			return &presets[i];
	}
	return NULL;
}
