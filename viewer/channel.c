/* SPDX-License-Identifier: MIT */
#include "viewer/channel.h"

#include <errno.h>
#include <string.h>

#include <xxhash.h>

#include "formats/base/check.h"

static const struct {
	const char *name;
	size_t pixel_bytes;
} channels[CHANNEL_COUNT_] = {
	[CHANNEL_COLOUR] = { "colour", 4 }, [CHANNEL_PART] = { "part", 8 },
	[CHANNEL_NODE] = { "node", 8 },     [CHANNEL_TRIANGLE] = { "triangle", 8 },
	[CHANNEL_DEPTH] = { "depth", 4 },   [CHANNEL_NORMAL] = { "normal", 12 },
};

const char *channel_name(enum channel channel)
{
	CHECK(channel < CHANNEL_COUNT_);
	return channels[channel].name;
}

int channel_from_name(const char *name)
{
	for (int i = 0; i < CHANNEL_COUNT_; i++) {
		if (strcmp(name, channels[i].name) == 0)
			return i;
	}
	return -EINVAL;
}

size_t channel_pixel_bytes(enum channel channel)
{
	CHECK(channel < CHANNEL_COUNT_);
	return channels[channel].pixel_bytes;
}

void channel_item_colour(uint64_t item, uint8_t ret[3])
{
	uint64_t hash = XXH3_64bits(&item, sizeof(item));

	/* Neither near black nor near white, so that both stay for the background. */
	for (int i = 0; i < 3; i++)
		ret[i] = (uint8_t)(40 + (hash >> (8 * i) & 0xff) * 200 / 255);
}
