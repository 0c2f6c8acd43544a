/* SPDX-License-Identifier: MIT */
#include "tests/model/region.h"

#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "daemon/arena/memfile.h"
#include "formats/base/bytes.h"
#include "formats/base/check.h"

#define REGION_BYTES (256 * KIB)
#define CHUNK_BYTES  64u
#define CHUNK_COUNT  (REGION_BYTES / CHUNK_BYTES)

/* Before each allocation, so that realloc() knows how much to copy. */
struct head {
	size_t size_bytes;
	size_t padding;
};

struct region_state {
	size_t used_bytes;
	uint32_t chunk_count;
	uint16_t chunks[];
	/* Then the chunks' bytes. */
};

static _Alignas(CHUNK_BYTES) uint8_t region[REGION_BYTES];
static _Alignas(CHUNK_BYTES) uint8_t base[REGION_BYTES];
static size_t used_bytes;
static bool is_on;

static bool is_inside(const void *pointer)
{
	return (const uint8_t *)pointer >= region &&
	       (const uint8_t *)pointer < region + REGION_BYTES;
}

void region_reset(void)
{
	memset(region, 0, sizeof(region));
	used_bytes = 0;
}

void region_use(int on)
{
	is_on = on;
}

void *region_take(size_t size_bytes)
{
	struct head *head = (struct head *)(void *)(region + used_bytes);

	CHECK(size_bytes <= REGION_BYTES - used_bytes - sizeof(*head));
	used_bytes += bytes_round_up(sizeof(*head) + size_bytes, sizeof(*head));
	head->size_bytes = size_bytes;
	memset(head + 1, 0, size_bytes);
	return head + 1;
}

void region_note_base(void)
{
	memcpy(base, region, sizeof(region));
}

struct region_state *region_save(void)
{
	static uint16_t chunks[CHUNK_COUNT];
	uint32_t chunk_count = 0;
	struct region_state *state;
	uint8_t *bytes;

	for (uint32_t i = 0; i * CHUNK_BYTES < used_bytes; i++)
		if (memcmp(region + (size_t)i * CHUNK_BYTES, base + (size_t)i * CHUNK_BYTES,
			   CHUNK_BYTES) != 0)
			chunks[chunk_count++] = (uint16_t)i;
	state = malloc(sizeof(*state) + chunk_count * (sizeof(chunks[0]) + CHUNK_BYTES));
	CHECK(state != NULL);
	state->used_bytes = used_bytes;
	state->chunk_count = chunk_count;
	memcpy(state->chunks, chunks, chunk_count * sizeof(chunks[0]));
	bytes = (uint8_t *)&state->chunks[chunk_count];
	for (uint32_t i = 0; i < chunk_count; i++)
		memcpy(bytes + (size_t)i * CHUNK_BYTES, region + (size_t)chunks[i] * CHUNK_BYTES,
		       CHUNK_BYTES);
	return state;
}

void region_load(const struct region_state *state)
{
	const uint8_t *bytes = (const uint8_t *)&state->chunks[state->chunk_count];

	memcpy(region, base, u64_max(used_bytes, state->used_bytes));
	for (uint32_t i = 0; i < state->chunk_count; i++)
		memcpy(region + (size_t)state->chunks[i] * CHUNK_BYTES,
		       bytes + (size_t)i * CHUNK_BYTES, CHUNK_BYTES);
	used_bytes = state->used_bytes;
}

/* ---- what the linker sends here ---- */

void *__real_malloc(size_t size);
void *__wrap_malloc(size_t size);
void *__wrap_malloc(size_t size)
{
	return is_on ? region_take(size) : __real_malloc(size);
}

void *__real_calloc(size_t count, size_t size);
void *__wrap_calloc(size_t count, size_t size);
void *__wrap_calloc(size_t count, size_t size)
{
	return is_on ? region_take(count * size) : __real_calloc(count, size);
}

void *__real_realloc(void *pointer, size_t size);
void *__wrap_realloc(void *pointer, size_t size);
void *__wrap_realloc(void *pointer, size_t size)
{
	void *copy;

	if (!is_on)
		return __real_realloc(pointer, size);
	copy = region_take(size);
	if (pointer)
		memcpy(copy, pointer, u64_min(size, ((struct head *)pointer)[-1].size_bytes));
	return copy;
}

void __real_free(void *pointer);
void __wrap_free(void *pointer);
void __wrap_free(void *pointer)
{
	if (!is_inside(pointer))
		__real_free(pointer);
}

/* No descriptors: nobody but this program looks at the memory. */
int __wrap_memfile_create(const char *name, uint64_t bytes, bool huge, struct memfile *ret,
			  struct why *why);
int __wrap_memfile_create(const char *name, uint64_t bytes, bool huge, struct memfile *ret,
			  struct why *why)
{
	(void)name;
	(void)huge;
	(void)why;
	*ret = MEMFILE_NONE;
	ret->bytes = bytes;
	ret->base = region_take(bytes);
	return 0;
}

int __wrap_memfile_publish(struct memfile *memfile, enum memfile_content content, struct why *why);
int __wrap_memfile_publish(struct memfile *memfile, enum memfile_content content, struct why *why)
{
	(void)memfile;
	(void)content;
	(void)why;
	return 0;
}

void __wrap_memfile_done(struct memfile *memfile);
void __wrap_memfile_done(struct memfile *memfile)
{
	*memfile = MEMFILE_NONE;
}
