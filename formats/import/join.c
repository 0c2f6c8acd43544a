/* SPDX-License-Identifier: MIT */
#include "formats/import/join.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"

#define CHUNK_BYTES_MIN  256u
#define CHUNK_BYTES_MAX  (UINT32_C(1) << 18)
#define RECORD_BYTES_MAX 64u
/* Memory goes to the range at hand (half) and to the chunks of all streams (a quarter each). */
#define RANGE_SHARE  2
#define STREAM_SHARE 4

/* A reference in its stream: how much further than the stream's last one, and the value. */
struct reference {
	uint32_t step;
	uint32_t value; /* within the range */
};

/* A step that is only one: too long for 32 bits, the next reference goes on from it. */
#define STEP_ONLY UINT32_MAX

struct join *join_destroy(struct join *join)
{
	if (!join)
		return NULL;
	spill_destroy(join->values);
	spill_destroy(join->references);
	spill_destroy(join->results);
	free(join->records);
	free(join);
	return NULL;
}

int join_create(struct scratch *scratch, uint32_t record_bytes, uint64_t memory_bytes,
		struct join **ret, struct why *why)
{
	struct join *join = calloc(1, sizeof(*join));
	uint64_t chunk_bytes = memory_bytes / STREAM_SHARE / JOIN_STREAMS_MAX;
	int r;

	CHECK(record_bytes <= RECORD_BYTES_MAX);
	if (!join)
		return why_set(why, -ENOMEM, "no memory to join faces and vertices");
	join->scratch = scratch;
	join->memory_bytes = memory_bytes;
	join->record_bytes = record_bytes;
	join->chunk_bytes = CHUNK_BYTES_MIN;
	while (join->chunk_bytes < CHUNK_BYTES_MAX && 2 * join->chunk_bytes <= chunk_bytes)
		join->chunk_bytes *= 2;
	join->range_records = u64_min(memory_bytes / RANGE_SHARE / record_bytes, UINT32_MAX);
	join->range_records = u64_max(join->range_records, 1);
	r = spill_create(scratch, 1, join->chunk_bytes, &join->values, why);
	if (r == 0)
		r = spill_create(scratch, JOIN_STREAMS_MAX, join->chunk_bytes, &join->references,
				 why);
	if (r < 0) {
		join_destroy(join);
		return r;
	}
	*ret = join;
	return 0;
}

int join_add(struct join *join, const void *records, uint64_t count, struct why *why)
{
	const uint8_t *from = records;

	while (count > 0) {
		uint32_t piece = (uint32_t)u64_min(count, UINT32_MAX / RECORD_BYTES_MAX);
		int r = spill_write(join->values, 0, from, piece * join->record_bytes, why);

		if (r < 0)
			return r;
		from += (uint64_t)piece * join->record_bytes;
		join->value_count += piece;
		count -= piece;
	}
	return 0;
}

int join_refer(struct join *join, uint64_t index, struct why *why)
{
	uint64_t range = index / join->range_records;
	uint64_t number = join->reference_count++;
	struct reference reference = { .value = (uint32_t)(index % join->range_records) };
	uint64_t step;

	join->index_max = u64_max(join->index_max, index);
	/* join_resolve() says which of two faults this is. */
	if (range >= JOIN_STREAMS_MAX)
		return 0;
	step = number - join->last_reference[range];
	join->last_reference[range] = number;
	for (; step >= STEP_ONLY; step -= STEP_ONLY) {
		struct reference far = { .step = STEP_ONLY };
		int r = spill_write(join->references, (uint32_t)range, &far, sizeof(far), why);

		if (r < 0)
			return r;
	}
	reference.step = (uint32_t)step;
	return spill_write(join->references, (uint32_t)range, &reference, sizeof(reference), why);
}

static int too_large(const struct join *join, struct why *why)
{
	return why_set(
		why, -ENOMEM, "%llu vertices and %llu corners are too many for %llu MiB of memory",
		(unsigned long long)join->value_count, (unsigned long long)join->reference_count,
		(unsigned long long)(join->memory_bytes / MIB));
}

/* Resolves the references into one range of values, which is the next one in their stream. */
static int resolve_range(struct join *join, uint32_t range, struct why *why)
{
	uint64_t first = range * join->range_records;
	uint64_t count = u64_min(join->value_count - first, join->range_records);
	uint64_t number = 0;
	int r;

	for (uint64_t done = 0; done < count;) {
		uint64_t piece = u64_min(count - done, UINT32_MAX / RECORD_BYTES_MAX);

		r = spill_read(join->values, 0, join->records + done * join->record_bytes,
			       (uint32_t)piece * join->record_bytes, why);
		if (r <= 0)
			return r < 0 ? r : why_set(why, -EIO, "a scratch file ends too early");
		done += piece;
	}
	for (;;) {
		uint8_t result[sizeof(uint32_t) + RECORD_BYTES_MAX];
		struct reference reference;
		uint32_t slot, stream;

		r = spill_read(join->references, range, &reference, sizeof(reference), why);
		if (r <= 0)
			break;
		number += reference.step;
		if (reference.step == STEP_ONLY)
			continue;
		stream = (uint32_t)(number / join->range_records);
		slot = (uint32_t)(number % join->range_records);
		memcpy(result, &slot, sizeof(slot));
		memcpy(result + sizeof(slot),
		       join->records + (uint64_t)reference.value * join->record_bytes,
		       join->record_bytes);
		r = spill_write(join->results, stream, result,
				(uint32_t)sizeof(slot) + join->record_bytes, why);
		if (r < 0)
			break;
	}
	spill_stream_done(join->references, range);
	return r;
}

int join_resolve(struct join *join, struct why *why)
{
	uint64_t value_ranges = (join->value_count + join->range_records - 1) / join->range_records;
	uint64_t result_ranges =
		(join->reference_count + join->range_records - 1) / join->range_records;
	int r;

	if (join->reference_count > 0 && join->index_max >= join->value_count)
		return why_set(why, -EUCLEAN, "a face points at vertex %llu of %llu",
			       (unsigned long long)join->index_max,
			       (unsigned long long)join->value_count);
	if (value_ranges > JOIN_STREAMS_MAX || result_ranges > JOIN_STREAMS_MAX)
		return too_large(join, why);
	if (join->reference_count == 0)
		return 0;
	join->records = malloc(join->range_records * join->record_bytes);
	if (!join->records)
		return why_set(why, -ENOMEM, "no memory to join faces and vertices");
	r = spill_create(join->scratch, (uint32_t)result_ranges, join->chunk_bytes, &join->results,
			 why);
	for (uint32_t range = 0; range < value_ranges && r == 0; range++)
		r = resolve_range(join, range, why);
	join->values = spill_destroy(join->values);
	join->references = spill_destroy(join->references);
	return r;
}

/* Puts the next range of results in order. */
static int load_results(struct join *join, struct why *why)
{
	uint32_t stream = (uint32_t)(join->next / join->range_records);
	uint8_t result[sizeof(uint32_t) + RECORD_BYTES_MAX];
	uint32_t slot;
	int r;

	while ((r = spill_read(join->results, stream, result,
			       (uint32_t)sizeof(slot) + join->record_bytes, why)) > 0) {
		memcpy(&slot, result, sizeof(slot));
		memcpy(join->records + (uint64_t)slot * join->record_bytes, result + sizeof(slot),
		       join->record_bytes);
	}
	spill_stream_done(join->results, stream);
	join->loaded_end = (stream + UINT64_C(1)) * join->range_records;
	return r;
}

int join_next(struct join *join, void *ret_record, struct why *why)
{
	CHECK(join->next < join->reference_count);
	if (join->next == join->loaded_end) {
		int r = load_results(join, why);

		if (r < 0)
			return r;
	}
	memcpy(ret_record, join->records + join->next % join->range_records * join->record_bytes,
	       join->record_bytes);
	join->next++;
	return 0;
}
