/* SPDX-License-Identifier: MIT */
/**
 * trace_layout.h - a trace as it lies in its file: header, blocks, and the kinds of events.
 *
 * formats/TRACE.md is the specification; this is the same in C.
 */
#ifndef FORMATS_TRACE_TRACE_LAYOUT_H
#define FORMATS_TRACE_TRACE_LAYOUT_H

#include <assert.h>
#include <stdint.h>

#define TRACE_MAGIC       "OOCTRACE"
#define TRACE_MAGIC_BYTES 8u
#define TRACE_VERSION     1u

/** Bytes of events in a block. */
#define TRACE_BLOCK_BYTES_MAX (UINT32_C(64) << 10)
#define TRACE_TICKS_PER_S     10000u
#define TRACE_NAME_BYTES      16u
#define TRACE_UUID_BYTES      16u
#define TRACE_PATH_BYTES_MAX  1023u
/** Payload sizes that can be: as in the store. */
#define TRACE_PAYLOAD_BYTES_MAX (UINT32_C(64) << 20)
#define TRACE_PAGE_BYTES        4096u
#define TRACE_PAGES_MAX         (TRACE_PAYLOAD_BYTES_MAX / TRACE_PAGE_BYTES)

/** First in the file. */
struct trace_header {
	uint8_t magic[TRACE_MAGIC_BYTES];
	uint32_t version;
	uint32_t page_bytes;                /* TRACE_PAGE_BYTES */
	uint64_t cache_bytes;               /* the budget when the trace began */
	uint64_t start_ns;                  /* since 1970 */
	char replacement[TRACE_NAME_BYTES]; /* the policy's name, padded with zeros */
	uint64_t reserved;                  /* 0 */
	uint64_t checksum;                  /* XXH3-64 of what stands before */
};

/** Before each block's events. */
struct trace_block {
	uint32_t bytes;    /* of its events, 1 .. TRACE_BLOCK_BYTES_MAX */
	uint32_t reserved; /* 0 */
	uint64_t checksum; /* of its events, seeded with the block's number from 0 */
};

static_assert(sizeof(struct trace_header) == 64, "as in TRACE.md");
static_assert(sizeof(struct trace_block) == 16, "as in TRACE.md");

/**
 * Kinds of events: X(NAME, argument).
 *
 *	COUNT    a number
 *	ENTRY    an entry of the trace's own table of nodes, as the distance from the entry of the
 *	         event of the same kind before
 */
#define TRACE_KINDS(X)                                                                             \
	X(TIME, COUNT)                                                                             \
	X(SESSION, COUNT)                                                                          \
	X(BEGIN, COUNT)                                                                            \
	X(END, COUNT)                                                                              \
	X(OPEN, COUNT)                                                                             \
	X(CLOSE, COUNT)                                                                            \
	X(NODE, COUNT)                                                                             \
	X(SET, COUNT)                                                                              \
	X(HIT, ENTRY)                                                                              \
	X(MISS, ENTRY)                                                                             \
	X(DROP, ENTRY)                                                                             \
	X(REFUSE, ENTRY)                                                                           \
	X(FETCH, ENTRY)                                                                            \
	X(PREFETCH, ENTRY)                                                                         \
	X(READY, ENTRY)                                                                            \
	X(FAIL, ENTRY)                                                                             \
	X(FREE, ENTRY)                                                                             \
	X(EVICT, ENTRY)                                                                            \
	X(ADOPT, ENTRY)

enum trace_kind {
#define TRACE_KIND_VALUE(name, argument) TRACE_##name,
	TRACE_KINDS(TRACE_KIND_VALUE)
#undef TRACE_KIND_VALUE
	TRACE_KIND_COUNT_
};

/** An event begins with a number of which so many bits, the lowest, are its kind. */
#define TRACE_KIND_BITS 5u

static_assert(TRACE_KIND_COUNT_ <= 1u << TRACE_KIND_BITS, "a kind fits");

#endif /* FORMATS_TRACE_TRACE_LAYOUT_H */
