/* SPDX-License-Identifier: MIT */
#include "tests/fuzz/fuzz_import.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <xxhash.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "formats/base/file.h"

#define MEMORY_PLENTY (64 * MIB)
#define MEMORY_SCARCE (48 * KIB)
/* A few bytes may ask for many copies of a shape: this many are enough to see. */
#define TRIANGLES_MAX 200000u

struct seen {
	uint64_t hash;
	uint64_t triangle_count;
	uint64_t part_count;
};

static void seen_add(struct seen *seen, const void *data, size_t size_bytes)
{
	seen->hash = XXH3_64bits_withSeed(data, size_bytes, seen->hash);
}

static int see_part(void *arg, const struct import_part *part, struct why *why)
{
	struct seen *seen = arg;

	(void)why;
	seen_add(seen, part->name, strlen(part->name));
	seen_add(seen, part->scene_path, strlen(part->scene_path));
	seen_add(seen, part->material, strlen(part->material));
	seen->part_count++;
	return 0;
}

static int see_batch(void *arg, const struct import_batch *batch, struct why *why)
{
	size_t corners = 3 * (size_t)batch->triangle_count;
	struct seen *seen = arg;

	CHECK(batch->triangle_count > 0 && batch->triangle_count <= IMPORT_BATCH_TRIANGLES);
	CHECK(batch->part < seen->part_count);
	seen_add(seen, &batch->part, sizeof(batch->part));
	if (batch->positions_double)
		seen_add(seen, batch->positions64, corners * 24);
	else
		seen_add(seen, batch->positions32, corners * 12);
	if (batch->normals)
		seen_add(seen, batch->normals, corners * 12);
	if (batch->colours)
		seen_add(seen, batch->colours, corners * 4);
	seen->triangle_count += batch->triangle_count;
	return seen->triangle_count > TRIANGLES_MAX ? why_set(why, -EFBIG, "enough") : 0;
}

static int import_once(fuzz_importer_fn importer, const char *path, uint64_t memory_bytes,
		       struct seen *seen)
{
	const struct import_options options = { .memory_bytes = memory_bytes,
						.scratch_directory = "/dev/shm" };
	const struct import_sink sink = { .part = see_part, .batch = see_batch, .arg = seen };
	struct import_info info = { 0 };
	struct import_job job = {
		.path = path,
		.options = &options,
		.sink = &sink,
		.info = &info,
		.scratch = { .directory = options.scratch_directory },
		.memory_bytes = memory_bytes,
	};
	struct why why = { .text = "" };
	int r = source_open(path, 4 * MIB, NULL, NULL, &job.source, &why);

	if (r == 0)
		r = importer(&job, &why);
	job.source = source_close(job.source);
	CHECK(job.scratch.live_bytes == 0);
	if (r == 0) {
		CHECK(info.triangle_count == seen->triangle_count);
		CHECK(info.part_count == seen->part_count);
	} else {
		/* A failure has a reason, in one line. */
		CHECK(why.text[0] != '\0');
		CHECK(!strchr(why.text, '\n'));
	}
	return r;
}

void fuzz_import(fuzz_importer_fn importer, const uint8_t *data, size_t size)
{
	AUTO_FD fd = memfd_create("fuzz", MFD_CLOEXEC);
	struct seen plenty = { 0 }, scarce = { 0 };
	char path[64];
	int plenty_r, scarce_r;

	CHECK(fd >= 0);
	CHECK(file_write_at(fd, data, size, 0) == 0);
	(void)snprintf(path, sizeof(path), "/proc/self/fd/%d", fd);
	plenty_r = import_once(importer, path, MEMORY_PLENTY, &plenty);
	scarce_r = import_once(importer, path, MEMORY_SCARCE, &scarce);
	/* A fault is found earlier or later, but what is read well is read the same. */
	if (plenty_r == 0 && scarce_r == 0)
		CHECK(plenty.hash == scarce.hash);
	else if (scarce_r == 0)
		CHECK(plenty_r == 0);
}
