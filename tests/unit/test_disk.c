/* SPDX-License-Identifier: MIT */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>

#include "daemon/fetch/disk.h"
#include "formats/base/bytes.h"
#include "formats/base/clock.h"
#include "tests/helper.h"

static struct disk disk_of(const char *profile)
{
	struct disk_profile parsed;
	struct disk disk;
	struct why why;

	assert_int_equal(disk_profile_parse(profile, &parsed, &why), 0);
	disk_init(&disk, &parsed);
	return disk;
}

static void disk_profile_parse_takes_names_and_numbers_and_nothing_else(void **state)
{
	static const char *const good[] = { "ide-2002", "hdd",  "sata-ssd",
					    "share",    "1M:0", "40M:12.5" };
	static const char *const bad[] = { "",       "floppy", "40M", "0:1",     ":1",     "40M:",
					   "40M:-1", "40M:x",  "x:1", "40M:1:2", "40M:1e9" };
	struct disk_profile profile;
	struct why why;

	(void)state;
	for (size_t i = 0; i < ARRAY_LENGTH(good); i++)
		assert_int_equal(disk_profile_parse(good[i], &profile, &why), 0);
	assert_int_equal(profile.bytes_per_s, 40 * MIB);
	assert_int_equal(profile.latency_ns, 12500 * NS_PER_US);
	for (size_t i = 0; i < ARRAY_LENGTH(bad); i++)
		assert_int_equal(disk_profile_parse(bad[i], &profile, &why), -EINVAL);
	assert_int_equal(profile.bytes_per_s, 40 * MIB);
}

static void disk_reads_one_after_the_other_at_its_bandwidth(void **state)
{
	struct disk disk = disk_of("1M:10");

	(void)state;
	/* The arm moves to the first byte, and is then where each next read begins. */
	assert_int_equal(disk_read(&disk, 0, 1, 4096, MIB), 10 * NS_PER_MS + NS_PER_S);
	assert_int_equal(disk_read(&disk, 0, 1, 4096 + MIB, MIB), 10 * NS_PER_MS + 2 * NS_PER_S);
	/* It moves for whatever lies elsewhere. */
	assert_int_equal(disk_read(&disk, 0, 1, 0, MIB), 20 * NS_PER_MS + 3 * NS_PER_S);
	/* And has been idle when it is asked late. */
	assert_int_equal(disk_read(&disk, 10 * NS_PER_S, 1, 0, MIB),
			 11 * NS_PER_S + 10 * NS_PER_MS);
}

static void disk_seeks_longer_for_what_lies_farther(void **state)
{
	struct disk near = disk_of("ide-2002");
	struct disk far = disk_of("ide-2002");

	(void)state;
	(void)disk_read(&near, 0, 1, 0, 4096);
	(void)disk_read(&far, 0, 1, 0, 4096);
	assert_true(disk_read(&near, 0, 1, 10 * MIB, 4096) < disk_read(&far, 0, 1, GIB, 4096));
	/* Half a turn at least, and no more than half a turn and the whole way. */
	assert_in_range(disk_read(&far, NS_PER_S, 1, 0, 4096) - NS_PER_S, 4 * NS_PER_MS,
			21 * NS_PER_MS);
}

static void disk_with_many_arms_overlaps_their_latencies_and_not_their_bytes(void **state)
{
	struct disk disk = disk_of("sata-ssd");
	uint64_t end_ns = 0;

	(void)state;
	for (uint64_t i = 0; i < 32; i++)
		end_ns = disk_read(&disk, 0, 1, (2 * i + 1) * MIB, 4096);
	/* 32 x 4 KiB at 520 MB/s after one latency of 90 us. */
	assert_in_range(end_ns, 300 * NS_PER_US, 360 * NS_PER_US);
	/* The 33rd waits for an arm. */
	assert_true(disk_read(&disk, 0, 1, 100 * MIB, 4096) >= 180 * NS_PER_US);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(disk_profile_parse_takes_names_and_numbers_and_nothing_else),
		cmocka_unit_test(disk_reads_one_after_the_other_at_its_bandwidth),
		cmocka_unit_test(disk_seeks_longer_for_what_lies_farther),
		cmocka_unit_test(disk_with_many_arms_overlaps_their_latencies_and_not_their_bytes),
	};

	return TEST_RUN(tests);
}
