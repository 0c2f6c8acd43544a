/* SPDX-License-Identifier: MIT */
#include "daemon/cache/reuse.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"

/* Ages in bins, four an octave. */
#define BIN_COUNT 128u
#define BIN_BITS  2u
/* Ages after which a node was wanted again, the last of them. */
#define GAP_COUNT 8u
/*
 * Kinds of nodes that are learned apart: new, prefetched, wanted again after about how long, and those
 * that have been here before: what came after the last gap that was like the last one will come again.
 */
#define KIND_NEW        0u
#define KIND_PREFETCHED 1u
#define KIND_GAP        2u
#define BINS_A_GAP      16u
#define KIND_NEXT       (KIND_GAP + BIN_COUNT / BINS_A_GAP)
#define BINS_A_NEXT     4u
#define KIND_COUNT      (KIND_NEXT + BIN_COUNT / BINS_A_NEXT)
/* What all nodes did counts as so many cases for each kind, until it has cases of its own. */
#define PRIOR_CASES 8.0f
/* Values are made anew when so many cases have begun since. */
#define VALUE_CASES 256u
/* What was learned counts half after so many cases, and two more for each node of the store. */
#define HALVE_CASES 8192u

/* A node's past. */
struct past {
	uint8_t gaps[GAP_COUNT]; /* bins, the last one first */
	uint8_t gap_count;
	uint8_t kind;
	bool is_open; /* a case: let go, and not wanted again yet */
};

struct reuse {
	uint32_t node_count;

	/* What was learned: of cases that began, how many ended at which age. */
	float begun[KIND_COUNT];
	float ended[KIND_COUNT][BIN_COUNT];
	uint64_t cases;       /* that ever began */
	uint32_t halve_cases; /* since all was halved */

	/* Of all kinds together, as PRIOR_CASES cases. */
	float prior_begun;
	float prior_ended[BIN_COUNT];
	uint64_t prior_made; /* `cases` then; 0: never */

	/* What keeping a node of an age is worth: wants a page and page of time. */
	float values[KIND_COUNT][BIN_COUNT + 1];
	uint64_t values_made[KIND_COUNT]; /* as prior_made */

	struct past pasts[]; /* node_count */
};

int reuse_create(uint32_t node_count, struct reuse **ret)
{
	struct reuse *reuse =
		calloc(1, sizeof(*reuse) + (size_t)node_count * sizeof(reuse->pasts[0]));

	if (!reuse)
		return -ENOMEM;
	reuse->node_count = node_count;
	*ret = reuse;
	return 0;
}

struct reuse *reuse_destroy(struct reuse *reuse)
{
	free(reuse);
	return NULL;
}

/* ---- ages ---- */

static uint32_t bin_of(uint64_t age)
{
	uint32_t log2;

	if (age < 1u << BIN_BITS)
		return (uint32_t)age;
	log2 = 63u - (uint32_t)__builtin_clzll(age);
	return (uint32_t)u64_min(((log2 - BIN_BITS + 1u) << BIN_BITS) +
					 ((age >> (log2 - BIN_BITS)) & ((1u << BIN_BITS) - 1u)),
				 BIN_COUNT - 1);
}

/* The least age of a bin. */
static float bin_begin(uint32_t bin)
{
	uint32_t octave = bin >> BIN_BITS;

	if (octave == 0)
		return (float)bin;
	return (float)((uint64_t)((1u << BIN_BITS) + (bin & ((1u << BIN_BITS) - 1u)))
		       << (octave - 1));
}

/* ---- learning ---- */

static void make_prior(struct reuse *reuse)
{
	float begun = 0;

	memset(reuse->prior_ended, 0, sizeof(reuse->prior_ended));
	for (uint32_t kind = 0; kind < KIND_COUNT; kind++) {
		begun += reuse->begun[kind];
		for (uint32_t bin = 0; bin < BIN_COUNT; bin++)
			reuse->prior_ended[bin] += reuse->ended[kind][bin];
	}
	reuse->prior_begun = begun > 0 ? PRIOR_CASES : 0;
	for (uint32_t bin = 0; bin < BIN_COUNT && begun > 0; bin++)
		reuse->prior_ended[bin] *= PRIOR_CASES / begun;
	reuse->prior_made = reuse->cases;
}

/* Cases that ended at the ages of one bin. */
struct ends {
	uint32_t bin;
	float count;
	float middle; /* of the bin's ages */
	float end;
};

/*
 * What it is worth to keep a node that has reached an age: of all horizons the best rate of cases that
 * end before it, for the time that nodes stay until they are wanted or the horizon is reached.
 *
 * ends:  what ends later, in order.
 */
static float value_at(const struct ends *ends, uint32_t ends_count, float at_risk, float age)
{
	float wanted = 0;
	float time = 0; /* of those that are wanted before the horizon */
	float best = 0;

	for (uint32_t i = 0; i < ends_count; i++) {
		float spent;

		wanted += ends[i].count;
		time += ends[i].count * (ends[i].middle - age);
		spent = time + (at_risk - wanted) * (ends[i].end - age);
		best = wanted > best * spent ? wanted / spent : best;
	}
	return best;
}

/* Most bins are of ages at which nothing ends: only the others are gone through for each. */
static void make_values(struct reuse *reuse, uint32_t kind)
{
	float at_risk = reuse->begun[kind] + reuse->prior_begun;
	float *values = reuse->values[kind];
	struct ends ends[BIN_COUNT];
	uint32_t count = 0;
	uint32_t first = 0;

	for (uint32_t bin = 0; bin < BIN_COUNT; bin++) {
		float ended = reuse->ended[kind][bin] + reuse->prior_ended[bin];

		if (ended > 0)
			ends[count++] = (struct ends){
				.bin = bin,
				.count = ended,
				.middle = 0.5f * (bin_begin(bin) + bin_begin(bin + 1)),
				.end = bin_begin(bin + 1),
			};
	}
	for (uint32_t bin = 0; bin < BIN_COUNT; bin++) {
		values[bin] = value_at(ends + first, count - first, at_risk, bin_begin(bin));
		if (first < count && ends[first].bin == bin)
			at_risk -= ends[first++].count;
	}
	values[BIN_COUNT] = 0;
	reuse->values_made[kind] = reuse->cases;
}

/* They cost more than the rest together, so they are made of the kinds that are asked for, and then. */
static const float *values_of(struct reuse *reuse, uint32_t kind)
{
	if (reuse->cases - reuse->prior_made >= VALUE_CASES)
		make_prior(reuse);
	if (reuse->cases - reuse->values_made[kind] >= VALUE_CASES)
		make_values(reuse, kind);
	return reuse->values[kind];
}

static void halve(struct reuse *reuse)
{
	for (uint32_t kind = 0; kind < KIND_COUNT; kind++) {
		reuse->begun[kind] *= 0.5f;
		for (uint32_t bin = 0; bin < BIN_COUNT; bin++)
			reuse->ended[kind][bin] *= 0.5f;
	}
	reuse->halve_cases = 0;
}

/* Bins so near count as the same gap. */
static bool is_like(uint8_t a, uint8_t b)
{
	return a <= b + 1 && b <= a + 1;
}

static uint8_t kind_of(const struct past *past)
{
	if (past->gap_count == 0)
		return KIND_NEW;
	for (unsigned i = 1; i < past->gap_count; i++)
		if (is_like(past->gaps[i], past->gaps[0]))
			return (uint8_t)(KIND_NEXT + past->gaps[i - 1] / BINS_A_NEXT);
	return (uint8_t)(KIND_GAP + past->gaps[0] / BINS_A_GAP);
}

void reuse_begin(struct reuse *reuse, uint32_t index, bool was_used)
{
	struct past *past = &reuse->pasts[index];

	CHECK(index < reuse->node_count);
	past->kind = was_used ? kind_of(past) : KIND_PREFETCHED;
	past->is_open = true;
	reuse->begun[past->kind]++;
	if (++reuse->halve_cases > HALVE_CASES + 2 * (uint64_t)reuse->node_count)
		halve(reuse);
	reuse->cases++;
}

void reuse_end(struct reuse *reuse, uint32_t index, uint64_t age)
{
	struct past *past = &reuse->pasts[index];
	uint32_t bin = bin_of(age);

	CHECK(index < reuse->node_count);
	if (!past->is_open)
		return;
	past->is_open = false;
	reuse->ended[past->kind][bin]++;
	memmove(past->gaps + 1, past->gaps, GAP_COUNT - 1);
	past->gaps[0] = (uint8_t)bin;
	past->gap_count += past->gap_count < GAP_COUNT;
}

double reuse_value(struct reuse *reuse, uint32_t index, uint64_t age)
{
	const float *values = values_of(reuse, reuse->pasts[index].kind);
	uint32_t bin = bin_of(age);
	float begin = bin_begin(bin);
	float value = values[bin] + (values[bin + 1] - values[bin]) * ((float)age - begin) /
					    (bin_begin(bin + 1) - begin);

	return value > 0 ? (double)value : 0;
}
