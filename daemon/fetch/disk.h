/* SPDX-License-Identifier: MIT */
/**
 * disk.h - when a read would have ended on another storage device: for measuring, on any machine,
 * what a slow one costs.
 *
 * A device has `parallel` arms.  A read waits for an arm, then for that arm to be in place (seek and
 * half a turn, unless it goes on where one has just ended), then for the channel, over which bytes
 * come one read after the other.  Reads are taken in the order in which they are given; a device
 * that sorts them would be somewhat faster.
 *
 * Threads: loop thread; no clock of its own.
 * Source: seek times as in Ruemmler and Wilkes, "An introduction to disk drive modeling", 1994:
 *	a constant and a square root of the distance.
 */
#ifndef DAEMON_FETCH_DISK_H
#define DAEMON_FETCH_DISK_H

#include <stdint.h>

#include "formats/base/why.h"

#define DISK_ARM_COUNT_MAX 64u

struct disk_profile {
	const char *name;
	uint64_t bytes_per_s;
	uint64_t latency_ns;     /* of every read that moves an arm: half a turn, or a round trip */
	uint64_t seek_ns;        /* of the whole way from one end to the other; 0: nothing moves */
	uint64_t capacity_bytes; /* what the whole way is */
	uint32_t parallel;       /* 1 .. DISK_ARM_COUNT_MAX */
};

/**
 * A profile by its name (ide-2002, hdd, sata-ssd, share) or as BANDWIDTH:LATENCY, bytes a second and
 * milliseconds: "40M:12.5".
 *
 * Returns: 0, or -EINVAL with what is allowed.
 */
int disk_profile_parse(const char *text, struct disk_profile *ret, struct why *why);

struct disk_arm {
	uint64_t free_ns;   /* when it can take the next read */
	uint32_t file;      /* where it stands */
	uint64_t at_offset; /* behind the last byte read */
};

struct disk {
	struct disk_profile profile;
	uint64_t channel_free_ns;
	struct disk_arm arms[DISK_ARM_COUNT_MAX];
};

void disk_init(struct disk *disk, const struct disk_profile *profile);

/** Takes a read that is given at now_ns.  Returns: when it ends. */
uint64_t disk_read(struct disk *disk, uint64_t now_ns, uint32_t file, uint64_t file_offset,
		   uint32_t bytes);

#endif /* DAEMON_FETCH_DISK_H */
