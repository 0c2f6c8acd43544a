/* SPDX-License-Identifier: MIT */
/**
 * borders.h - normals that do not show where the model was cut.
 *
 * A position belongs to the bucket whose cells hold it.  A triangle of another bucket that has a
 * corner there sends the owner a *border record*: position, section, face normal, and who asks.  The
 * owner thus knows all faces around its positions.  In a phase of its own it answers each record
 * with the finished normal, and when buckets are cut, everyone has what the whole model would have
 * given.
 *
 * A bucket that is too large to be held (bucket.whole) takes part with records alone: its corners
 * get the normals of their faces.
 *
 * Threads: borders_answer() runs its own; the rest from any.
 */
#ifndef TOOLS_BUILD_BORDERS_H
#define TOOLS_BUILD_BORDERS_H

#include <stdint.h>

#include "formats/base/why.h"
#include "tools/build/buckets.h"
#include "tools/build/crew.h"
#include "tools/build/exchange.h"
#include "tools/build/normals.h"
#include "tools/build/patch.h"
#include "tools/build/progress.h"

/** A corner on its way to the owner of its position; the position's words come first. */
struct border_record {
	uint32_t section;
	uint32_t bucket; /* that asks */
	uint64_t origin; /* of the fragment of that bucket's triangles ... */
	uint32_t corner; /* ... and the number of the corner in it: 3 x triangle + corner */
	uint16_t weight; /* 0: a replica asks; the face is told of by another */
	int16_t normal[3];
};

/** Words of a border record in an exchange. */
static inline uint32_t border_words(const struct grid *grid)
{
	return grid_position_words(grid) + (uint32_t)(sizeof(struct border_record) / 4);
}

/** The owner's answer. */
struct border_answer {
	uint64_t origin;
	uint32_t corner;
	uint32_t normal; /* code */
};

/** More records than these for one bucket are not answered: their corners stay flat. */
#define BORDER_RECORDS_MAX (UINT32_C(1) << 18)

struct borders {
	const struct grid *grid;
	const struct record_shape *shape;
	const struct buckets *buckets;
	const struct labels *labels;
	const struct exchange *triangles;
	const struct exchange *records;
	struct exchange *answers;
	enum normals_mode mode;
	int32_t threshold;
	struct crew *crew;
	struct progress *progress;
};

/** Memory that each worker of borders_answer() takes. */
uint64_t borders_worker_bytes(const struct borders *borders);

/** Answers all records and seals the answers.  Returns: 0, -ENOMEM, -ECANCELED or -errno. */
int borders_answer(const struct borders *borders, uint32_t worker_count, struct why *why);

/** What a worker keeps between buckets. */
struct borders_scratch {
	uint8_t *records;
	uint64_t records_max_bytes;
	struct normal_share *shares;
	uint32_t *codes;
	uint32_t share_max;
	uint32_t *next; /* per record: the next of the same point */
	uint32_t *head; /* per point */
	uint32_t next_max;
	uint32_t head_max;
};

void borders_scratch_done(struct borders_scratch *scratch);

/**
 * Fills patch->normals of a bucket whose points are known: its own positions from its faces and the
 * border records, the others from the answers.
 *
 * Returns: 0, -ENOMEM or -errno of scratch.
 */
int borders_fill_normals(const struct borders *borders, uint32_t bucket, struct patch *patch,
			 struct borders_scratch *scratch, struct why *why);

#endif /* TOOLS_BUILD_BORDERS_H */
