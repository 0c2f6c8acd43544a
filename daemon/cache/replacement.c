/* SPDX-License-Identifier: MIT */
#include "daemon/cache/replacement.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"

#define SLOT_NONE UINT32_MAX

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
/* Cases between two looks at what was learned. */
#define LEARN_CASES 256u
/* What was learned counts half after so many cases, and two more for each node of the store. */
#define HALVE_CASES 8192u
/* Nodes that are looked at, at random, for one to go. */
#define SAMPLE_COUNT 64u

/* A node's past. */
struct past {
	uint64_t let_go;         /* when, last; 0: never */
	uint32_t slot;           /* in `free`; SLOT_NONE: it may not go */
	uint8_t gaps[GAP_COUNT]; /* bins, the last one first */
	uint8_t gap_count;
	uint8_t kind;
	bool is_open; /* a case: let go, and not wanted again yet */
};

struct replacement {
	uint32_t node_count;
	uint64_t clock; /* pages let go */
	uint64_t random;

	uint32_t free_count;
	uint32_t *free; /* nodes that may go, in no order */

	/* What was learned: of cases that began, how many ended at which age. */
	float begun[KIND_COUNT];
	float ended[KIND_COUNT][BIN_COUNT];
	uint32_t cases;       /* since the values were made */
	uint32_t halve_cases; /* since all was halved */
	/* What keeping a node of an age is worth: wants a page and page of time. */
	float values[KIND_COUNT][BIN_COUNT + 1];

	struct past pasts[]; /* node_count */
};

static const char *const names[REPLACEMENT_COUNT_] = {
#define REPLACEMENT_NAME(name) [REPLACEMENT_##name] = #name,
	REPLACEMENTS(REPLACEMENT_NAME)
#undef REPLACEMENT_NAME
};

const char *replacement_name(enum replacement_policy policy)
{
	CHECK(policy < REPLACEMENT_COUNT_);
	return names[policy];
}

int replacement_find(const char *name, enum replacement_policy *ret)
{
	for (unsigned i = 0; i < REPLACEMENT_COUNT_; i++) {
		if (strcmp(name, names[i]) != 0)
			continue;
		*ret = (enum replacement_policy)i;
		return 0;
	}
	return -EINVAL;
}

int replacement_create(enum replacement_policy policy, uint32_t node_count,
		       struct replacement **ret)
{
	struct replacement *replacement;

	*ret = NULL;
	if (policy == REPLACEMENT_lru)
		return 0;
	replacement = calloc(1, sizeof(*replacement) +
					(size_t)node_count * sizeof(replacement->pasts[0]));
	if (!replacement)
		return -ENOMEM;
	replacement->free = malloc((size_t)node_count * sizeof(*replacement->free) + 1);
	if (!replacement->free) {
		free(replacement);
		return -ENOMEM;
	}
	replacement->node_count = node_count;
	replacement->random = UINT64_C(0x9e3779b97f4a7c15);
	for (uint32_t i = 0; i < node_count; i++)
		replacement->pasts[i].slot = SLOT_NONE;
	*ret = replacement;
	return 0;
}

struct replacement *replacement_destroy(struct replacement *replacement)
{
	if (!replacement)
		return NULL;
	free(replacement->free);
	free(replacement);
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

/* All that was learned, of all kinds together, as PRIOR_CASES cases. */
static void make_prior(const struct replacement *replacement, float *ret_begun, float *ret_ended)
{
	float begun = 0;

	memset(ret_ended, 0, BIN_COUNT * sizeof(*ret_ended));
	for (uint32_t kind = 0; kind < KIND_COUNT; kind++) {
		begun += replacement->begun[kind];
		for (uint32_t bin = 0; bin < BIN_COUNT; bin++)
			ret_ended[bin] += replacement->ended[kind][bin];
	}
	*ret_begun = begun > 0 ? PRIOR_CASES : 0;
	for (uint32_t bin = 0; bin < BIN_COUNT && begun > 0; bin++)
		ret_ended[bin] *= PRIOR_CASES / begun;
}

/*
 * What it is worth to keep a node that has reached a bin: of all horizons the best rate of cases that
 * end before it, for the time that nodes stay until they are wanted or the horizon is reached.
 */
static float value_at(const float *ended, float at_risk, uint32_t bin)
{
	float begin = bin_begin(bin);
	float wanted = 0;
	float time = 0; /* of those that are wanted before the horizon */
	float best = 0;

	for (uint32_t at = bin; at < BIN_COUNT; at++) {
		float end = bin_begin(at + 1);

		if (ended[at] == 0)
			continue;
		wanted += ended[at];
		time += ended[at] * (0.5f * (bin_begin(at) + end) - begin);
		best = wanted > best * (time + (at_risk - wanted) * (end - begin))
			       ? wanted / (time + (at_risk - wanted) * (end - begin))
			       : best;
	}
	return best;
}

static void learn(struct replacement *replacement)
{
	float prior_ended[BIN_COUNT];
	float prior_begun;

	make_prior(replacement, &prior_begun, prior_ended);
	for (uint32_t kind = 0; kind < KIND_COUNT; kind++) {
		float at_risk = replacement->begun[kind] + prior_begun;
		float ended[BIN_COUNT];

		for (uint32_t bin = 0; bin < BIN_COUNT; bin++)
			ended[bin] = replacement->ended[kind][bin] + prior_ended[bin];
		for (uint32_t bin = 0; bin < BIN_COUNT; bin++) {
			replacement->values[kind][bin] = value_at(ended, at_risk, bin);
			at_risk -= ended[bin];
		}
		replacement->values[kind][BIN_COUNT] = 0;
	}
	replacement->cases = 0;
}

static void halve(struct replacement *replacement)
{
	for (uint32_t kind = 0; kind < KIND_COUNT; kind++) {
		replacement->begun[kind] *= 0.5f;
		for (uint32_t bin = 0; bin < BIN_COUNT; bin++)
			replacement->ended[kind][bin] *= 0.5f;
	}
	replacement->halve_cases = 0;
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

static void begin_case(struct replacement *replacement, struct past *past, bool was_used)
{
	past->kind = was_used ? kind_of(past) : KIND_PREFETCHED;
	past->is_open = true;
	replacement->begun[past->kind]++;
	if (++replacement->halve_cases > HALVE_CASES + 2 * (uint64_t)replacement->node_count)
		halve(replacement);
	if (++replacement->cases == LEARN_CASES)
		learn(replacement);
}

static void end_case(struct replacement *replacement, struct past *past)
{
	uint32_t bin = bin_of(replacement->clock - past->let_go);

	past->is_open = false;
	replacement->ended[past->kind][bin]++;
	memmove(past->gaps + 1, past->gaps, GAP_COUNT - 1);
	past->gaps[0] = (uint8_t)bin;
	past->gap_count += past->gap_count < GAP_COUNT;
}

/* ---- what may go ---- */

static void add(struct replacement *replacement, uint32_t index)
{
	struct past *past = &replacement->pasts[index];

	CHECK(past->slot == SLOT_NONE);
	past->slot = replacement->free_count;
	replacement->free[replacement->free_count++] = index;
}

static void remove_slot(struct replacement *replacement, uint32_t index)
{
	struct past *past = &replacement->pasts[index];
	uint32_t last = replacement->free[--replacement->free_count];

	replacement->free[past->slot] = last;
	replacement->pasts[last].slot = past->slot;
	past->slot = SLOT_NONE;
}

void replacement_let_go(struct replacement *replacement, uint32_t index, uint32_t pages,
			bool was_used)
{
	struct past *past = &replacement->pasts[index];

	CHECK(index < replacement->node_count);
	replacement->clock += pages;
	past->let_go = replacement->clock;
	add(replacement, index);
	begin_case(replacement, past, was_used);
}

void replacement_use(struct replacement *replacement, uint32_t index)
{
	struct past *past = &replacement->pasts[index];

	CHECK(index < replacement->node_count);
	if (past->slot != SLOT_NONE)
		remove_slot(replacement, index);
	if (past->is_open)
		end_case(replacement, past);
}

void replacement_evict(struct replacement *replacement, uint32_t index)
{
	CHECK(index < replacement->node_count);
	CHECK(replacement->pasts[index].slot != SLOT_NONE);
	remove_slot(replacement, index);
}

uint32_t replacement_count(const struct replacement *replacement)
{
	return replacement->free_count;
}

bool replacement_has(const struct replacement *replacement, uint32_t index)
{
	return replacement->pasts[index].slot != SLOT_NONE;
}

/* ---- the order ---- */

uint64_t replacement_rank(const struct replacement *replacement, uint32_t index)
{
	const struct past *past = &replacement->pasts[index];
	uint64_t age = replacement->clock - past->let_go;
	const float *values = replacement->values[past->kind];
	uint32_t bin = bin_of(age);
	float begin = bin_begin(bin);
	uint32_t bits;
	float value;

	value = values[bin] + (values[bin + 1] - values[bin]) * ((float)age - begin) /
				      (bin_begin(bin + 1) - begin);
	/* Floats that are not negative are in the order of their bits; what is worth the same goes by age. */
	value = value > 0 ? value : 0;
	memcpy(&bits, &value, sizeof(bits));
	return ((uint64_t)bits << 32 | (uint32_t)past->let_go) + 1;
}

/* The best so far, in order. */
struct best {
	uint32_t *nodes;
	uint64_t ranks[SAMPLE_COUNT];
	uint32_t count;
	uint32_t count_max;
};

static void offer(const struct replacement *replacement, uint32_t index, struct best *best)
{
	uint64_t rank = replacement_rank(replacement, index);
	uint32_t at = best->count;

	for (uint32_t i = 0; i < best->count; i++)
		if (best->nodes[i] == index)
			return;
	if (best->count == best->count_max && rank >= best->ranks[best->count - 1])
		return;
	if (best->count < best->count_max)
		best->count++;
	else
		at--;
	for (; at > 0 && best->ranks[at - 1] > rank; at--) {
		best->ranks[at] = best->ranks[at - 1];
		best->nodes[at] = best->nodes[at - 1];
	}
	best->ranks[at] = rank;
	best->nodes[at] = index;
}

static uint64_t next_random(struct replacement *replacement)
{
	replacement->random ^= replacement->random << 13;
	replacement->random ^= replacement->random >> 7;
	replacement->random ^= replacement->random << 17;
	return replacement->random;
}

/* The order changes as nodes age, so there is no list of it: the best of a sample go. */
uint32_t replacement_candidates(struct replacement *replacement, uint32_t *ret, uint32_t count_max)
{
	struct best best = { .nodes = ret };
	bool is_all = replacement->free_count <= SAMPLE_COUNT;

	best.count_max = (uint32_t)u64_min(count_max, SAMPLE_COUNT);
	if (count_max == 0 || replacement->free_count == 0)
		return 0;
	for (uint32_t i = 0; i < (is_all ? replacement->free_count : SAMPLE_COUNT); i++)
		offer(replacement,
		      replacement
			      ->free[is_all ? i
					    : next_random(replacement) % replacement->free_count],
		      &best);
	return best.count;
}

void replacement_check(const struct replacement *replacement)
{
	uint32_t count = 0;

	for (uint32_t i = 0; i < replacement->node_count; i++) {
		const struct past *past = &replacement->pasts[i];

		CHECK(past->let_go <= replacement->clock);
		if (past->slot == SLOT_NONE)
			continue;
		CHECK(past->slot < replacement->free_count);
		CHECK(replacement->free[past->slot] == i);
		count++;
	}
	CHECK(count == replacement->free_count);
}
