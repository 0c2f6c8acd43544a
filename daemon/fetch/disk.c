/* SPDX-License-Identifier: MIT */
#include "daemon/fetch/disk.h"

#include <errno.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "formats/base/clock.h"
#include "formats/base/text.h"

#define US NS_PER_US
#define MS NS_PER_MS

/*
 * Data sheets: a 7,200 rpm IDE disk of 60 GB as it was sold in 2002, a 7,200 rpm disk of 4 TB, an SSD
 * on SATA, a file server over gigabit Ethernet whose own reads take a millisecond.
 */
static const struct disk_profile profiles[] = {
	{ "ide-2002", 40u * 1000 * 1000, 4170 * US, 16 * MS, UINT64_C(60) * 1000 * 1000 * 1000, 1 },
	{ "hdd", 180u * 1000 * 1000, 4170 * US, 16 * MS, UINT64_C(4000) * 1000 * 1000 * 1000, 1 },
	{ "sata-ssd", 520u * 1000 * 1000, 90 * US, 0, 0, 32 },
	{ "share", 110u * 1000 * 1000, 1200 * US, 0, 0, 16 },
};

/* "BANDWIDTH:LATENCY" */
static bool parse_numbers(const char *text, struct disk_profile *ret)
{
	const char *colon = strchr(text, ':');
	char bandwidth[TEXT_SIZE_BYTES];
	double latency_ms;

	if (!colon || (size_t)(colon - text) >= sizeof(bandwidth))
		return false;
	memcpy(bandwidth, text, (size_t)(colon - text));
	bandwidth[colon - text] = '\0';
	*ret = (struct disk_profile){ .name = "given", .parallel = 1 };
	if (text_to_size(bandwidth, &ret->bytes_per_s) < 0 || ret->bytes_per_s == 0)
		return false;
	if (text_to_double(colon + 1, &latency_ms) < 0 || !(latency_ms >= 0.0) ||
	    latency_ms > 60000.0)
		return false;
	ret->latency_ns = (uint64_t)(latency_ms * (double)MS);
	return true;
}

int disk_profile_parse(const char *text, struct disk_profile *ret, struct why *why)
{
	struct disk_profile profile;

	for (size_t i = 0; i < ARRAY_LENGTH(profiles); i++) {
		if (strcmp(text, profiles[i].name) == 0) {
			*ret = profiles[i];
			return 0;
		}
	}
	if (!parse_numbers(text, &profile))
		return why_set(why, -EINVAL,
			       "not ide-2002, hdd, sata-ssd, share, or bytes a second and "
			       "milliseconds as 40M:12.5");
	*ret = profile;
	return 0;
}

void disk_init(struct disk *disk, const struct disk_profile *profile)
{
	CHECK(profile->parallel >= 1 && profile->parallel <= DISK_ARM_COUNT_MAX);
	*disk = (struct disk){ .profile = *profile };
}

/* The arm that can begin first; of those that are idle, one that stands where the read begins. */
static struct disk_arm *arm_choose(struct disk *disk, uint64_t now_ns, uint32_t file,
				   uint64_t file_offset)
{
	struct disk_arm *best = &disk->arms[0];

	for (uint32_t i = 0; i < disk->profile.parallel; i++) {
		struct disk_arm *arm = &disk->arms[i];

		if (arm->free_ns <= now_ns && arm->file == file && arm->at_offset == file_offset)
			return arm;
		if (arm->free_ns < best->free_ns)
			best = arm;
	}
	return best;
}

static uint64_t move_ns(const struct disk_profile *profile, const struct disk_arm *arm,
			uint32_t file, uint64_t file_offset)
{
	double distance;

	if (arm->file == file && arm->at_offset == file_offset)
		return 0;
	if (profile->seek_ns == 0)
		return profile->latency_ns;
	/* Files lie a tenth of the disk apart. */
	distance = arm->file == file ? fabs((double)arm->at_offset - (double)file_offset) /
					       (double)profile->capacity_bytes
				     : 0.1;
	return profile->latency_ns +
	       (uint64_t)((double)profile->seek_ns * sqrt(fmin(distance, 1.0)));
}

uint64_t disk_read(struct disk *disk, uint64_t now_ns, uint32_t file, uint64_t file_offset,
		   uint32_t bytes)
{
	const struct disk_profile *profile = &disk->profile;
	struct disk_arm *arm = arm_choose(disk, now_ns, file, file_offset);
	uint64_t in_place_ns =
		u64_max(now_ns, arm->free_ns) + move_ns(profile, arm, file, file_offset);
	uint64_t end_ns =
		u64_max(in_place_ns, disk->channel_free_ns) +
		(uint64_t)((double)bytes * (double)NS_PER_S / (double)profile->bytes_per_s);

	disk->channel_free_ns = end_ns;
	*arm = (struct disk_arm){ end_ns, file, file_offset + bytes };
	return end_ns;
}
