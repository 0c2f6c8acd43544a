/* SPDX-License-Identifier: MIT */
/**
 * join.h - an array that is larger than memory, looked up by index in any order.
 *
 * Values are appended, references to them are appended, in any mixture; then the referenced values
 * come back in the order of the references.  Nothing is looked up one by one: references are
 * spread over streams by the range of values that they point into; one range after the other is
 * loaded and its references resolved, which spreads the results over streams by the range of
 * references that they belong to; and one range of these after the other is put in order in memory
 * and handed out.  Each byte is written and read a fixed number of times, in long runs, however
 * large the array is.  It is a Grace hash join whose hash is the index's upper bits.
 * Source: M. Kitsuregawa, H. Tanaka, T. Moto-oka, "Application of hash to data base machine and its
 * architecture", 1983.
 *
 * Memory: memory_bytes.  It suffices for JOIN_STREAMS_MAX / 2 times as many bytes of values.
 * Threads: one a join.
 */
#ifndef FORMATS_IMPORT_JOIN_H
#define FORMATS_IMPORT_JOIN_H

#include "formats/import/spill.h"

#define JOIN_STREAMS_MAX 1024u

struct join {
	struct scratch *scratch;
	uint64_t memory_bytes;
	uint32_t record_bytes;
	uint32_t chunk_bytes;
	uint64_t range_records; /* values, or results, that are in memory at a time */

	struct spill *values;     /* one stream */
	struct spill *references; /* a stream a range of values */
	struct spill *results;    /* a stream a range of references */
	uint64_t value_count;
	uint64_t reference_count;
	uint64_t index_max;
	uint64_t last_reference[JOIN_STREAMS_MAX]; /* by stream */

	uint8_t *records;    /* the range at hand */
	uint64_t next;       /* the reference whose value comes next */
	uint64_t loaded_end; /* the first reference behind the range at hand */
};

/**
 * record_bytes: of a value
 * memory_bytes: what it may take, all in all
 *
 * Returns: 0, -ENOMEM or -errno.  Ownership: ends with join_destroy().
 */
int join_create(struct scratch *scratch, uint32_t record_bytes, uint64_t memory_bytes,
		struct join **ret, struct why *why);
struct join *join_destroy(struct join *join);

/** Appends values.  Returns: 0, -ENOMEM or -errno. */
int join_add(struct join *join, const void *records, uint64_t count, struct why *why);

/** Appends a reference; its value may come later.  Returns: 0, -ENOMEM or -errno. */
int join_refer(struct join *join, uint64_t index, struct why *why);

/**
 * Resolves all references; nothing can be added any more.
 *
 * Returns: 0, -EUCLEAN when a reference points behind the values (join->index_max is the worst),
 * -ENOMEM when there are too many of either for memory_bytes, or -errno.
 */
int join_resolve(struct join *join, struct why *why);

/** The next reference's value.  There must be one.  Returns: 0 or -errno. */
int join_next(struct join *join, void *ret_record, struct why *why);

#endif /* FORMATS_IMPORT_JOIN_H */
