/* SPDX-License-Identifier: MIT */
#include "formats/trace/trace_code.h"

#include <errno.h>
#include <string.h>

#include "formats/base/check.h"

#define KIND_MASK ((1u << TRACE_KIND_BITS) - 1u)

enum argument {
	ARGUMENT_COUNT,
	ARGUMENT_ENTRY,
};

static const struct {
	const char *name;
	enum argument argument;
} kinds[TRACE_KIND_COUNT_] = {
#define TRACE_KIND_ROW(name, argument) [TRACE_##name] = { #name, ARGUMENT_##argument },
	TRACE_KINDS(TRACE_KIND_ROW)
#undef TRACE_KIND_ROW
};

bool trace_kind_has_entry(enum trace_kind kind)
{
	return kinds[kind].argument == ARGUMENT_ENTRY;
}

bool trace_kind_has_session(enum trace_kind kind)
{
	return kind == TRACE_BEGIN || kind == TRACE_END || kind == TRACE_SET || kind == TRACE_HIT ||
	       kind == TRACE_MISS || kind == TRACE_DROP || kind == TRACE_REFUSE;
}

const char *trace_kind_name(enum trace_kind kind)
{
	CHECK(kind < TRACE_KIND_COUNT_);
	return kinds[kind].name;
}

/* ---- numbers ---- */

/* Seven bits a byte, the lowest first; the highest bit of a byte says that more follow. */
static uint8_t *put_number(uint8_t *at, uint64_t number)
{
	for (; number >= 0x80; number >>= 7)
		*at++ = (uint8_t)(number | 0x80);
	*at++ = (uint8_t)number;
	return at;
}

struct input {
	const uint8_t *at;
	const uint8_t *end;
};

static int take_number(struct input *input, uint64_t number_max, uint64_t *ret)
{
	uint64_t number = 0;

	for (unsigned shift = 0; shift < 64; shift += 7) {
		uint8_t byte;

		if (input->at == input->end)
			return -ENODATA;
		byte = *input->at++;
		if (shift == 63 && byte > 1)
			return -EUCLEAN;
		number |= (uint64_t)(byte & 0x7f) << shift;
		if (byte & 0x80)
			continue;
		if (number > number_max)
			return -EUCLEAN;
		*ret = number;
		return 0;
	}
	return -EUCLEAN;
}

static int take_u32(struct input *input, uint32_t number_max, uint32_t *ret)
{
	uint64_t number = 0;
	int r = take_number(input, number_max, &number);

	*ret = (uint32_t)number;
	return r;
}

/* Distances both ways as numbers: 0, -1, 1, -2, ... */
static uint64_t zigzag(int64_t distance)
{
	return ((uint64_t)distance << 1) ^ (uint64_t)(distance >> 63);
}

static int64_t unzigzag(uint64_t number)
{
	return (int64_t)(number >> 1) ^ -(int64_t)(number & 1);
}

/* ---- encoding ---- */

static uint8_t *put_head(uint8_t *at, enum trace_kind kind, uint64_t argument)
{
	return put_number(at, argument << TRACE_KIND_BITS | (uint64_t)kind);
}

static uint64_t argument_of(struct trace_code *code, const struct trace_event *event)
{
	uint64_t argument;

	if (!trace_kind_has_entry(event->kind))
		return event->kind == TRACE_CLOSE || event->kind == TRACE_NODE ? event->store
									       : event->count;
	argument = zigzag((int64_t)event->entry - code->entries[event->kind]);
	code->entries[event->kind] = event->entry;
	return argument;
}

static uint8_t *put_rest(uint8_t *at, const struct trace_event *event)
{
	if (event->kind == TRACE_NODE) {
		at = put_number(at, event->node);
		at = put_number(at, event->pages);
		return put_number(at, event->bytes);
	}
	if (event->kind != TRACE_OPEN)
		return at;
	memcpy(at, event->uuid, TRACE_UUID_BYTES);
	at += TRACE_UUID_BYTES;
	at = put_number(at, event->path_bytes);
	memcpy(at, event->path, event->path_bytes);
	return at + event->path_bytes;
}

size_t trace_encode(struct trace_code *code, const struct trace_event *event, uint8_t *ret)
{
	uint8_t *at = ret;

	CHECK(event->kind < TRACE_KIND_COUNT_);
	CHECK(event->kind != TRACE_TIME && event->kind != TRACE_SESSION);
	CHECK(event->ticks >= code->ticks);
	CHECK(event->kind != TRACE_OPEN || event->path_bytes <= TRACE_PATH_BYTES_MAX);
	if (event->ticks > code->ticks)
		at = put_head(at, TRACE_TIME, event->ticks - code->ticks);
	code->ticks = event->ticks;
	if (trace_kind_has_session(event->kind) && event->session != code->session) {
		at = put_head(at, TRACE_SESSION, event->session);
		code->session = event->session;
	}
	at = put_head(at, event->kind, argument_of(code, event));
	return (size_t)(put_rest(at, event) - ret);
}

/* ---- decoding ---- */

static int take_rest(struct input *input, struct trace_event *ret)
{
	int r;

	if (ret->kind == TRACE_NODE) {
		r = take_u32(input, UINT32_MAX - 1, &ret->node);
		if (r == 0)
			r = take_u32(input, TRACE_PAGES_MAX, &ret->pages);
		if (r == 0)
			r = take_u32(input, TRACE_PAYLOAD_BYTES_MAX, &ret->bytes);
		return r == 0 && (ret->pages == 0 || ret->bytes == 0) ? -EUCLEAN : r;
	}
	if (ret->kind != TRACE_OPEN)
		return 0;
	if ((size_t)(input->end - input->at) < TRACE_UUID_BYTES)
		return -ENODATA;
	memcpy(ret->uuid, input->at, TRACE_UUID_BYTES);
	input->at += TRACE_UUID_BYTES;
	r = take_u32(input, TRACE_PATH_BYTES_MAX, &ret->path_bytes);
	if (r < 0)
		return r;
	if ((size_t)(input->end - input->at) < ret->path_bytes)
		return -ENODATA;
	if (memchr(input->at, '\0', ret->path_bytes))
		return -EUCLEAN;
	ret->path = (const char *)input->at;
	input->at += ret->path_bytes;
	return 0;
}

/* Sets what the argument says.  Returns: 0 or -EUCLEAN. */
static int take_argument(struct trace_code *code, uint64_t argument, struct trace_event *ret)
{
	int64_t entry;

	if (!trace_kind_has_entry(ret->kind)) {
		if (argument > UINT32_MAX)
			return -EUCLEAN;
		ret->count = (uint32_t)argument;
		ret->store = (uint32_t)argument;
		return 0;
	}
	/* The head's number has 64 bits, so the distance has less and the sum cannot overflow. */
	entry = code->entries[ret->kind] + unzigzag(argument);
	if (entry < 0 || entry > UINT32_MAX)
		return -EUCLEAN;
	ret->entry = (uint32_t)entry;
	code->entries[ret->kind] = (uint32_t)entry;
	return 0;
}

/* What is said once for many events.  Returns: 1 (it was that), 0 (it was not) or -EUCLEAN. */
static int take_context(struct trace_code *code, enum trace_kind kind, uint64_t argument)
{
	if (kind == TRACE_TIME)
		return __builtin_add_overflow(code->ticks, argument, &code->ticks) ? -EUCLEAN : 1;
	if (kind != TRACE_SESSION)
		return 0;
	if (argument > UINT32_MAX)
		return -EUCLEAN;
	code->session = (uint32_t)argument;
	return 1;
}

int trace_decode(struct trace_code *code, const uint8_t *bytes, size_t byte_count,
		 struct trace_event *ret, size_t *ret_used)
{
	struct input input = { bytes, bytes + byte_count };
	uint64_t argument;
	int r;

	do {
		uint64_t head = 0;

		r = take_number(&input, UINT64_MAX, &head);
		if (r < 0)
			return r;
		argument = head >> TRACE_KIND_BITS;
		if ((head & KIND_MASK) >= TRACE_KIND_COUNT_)
			return -EUCLEAN;
		ret->kind = (enum trace_kind)(head & KIND_MASK);
		r = take_context(code, ret->kind, argument);
	} while (r > 0);
	if (r < 0)
		return r;
	ret->ticks = code->ticks;
	ret->session = code->session;
	r = take_argument(code, argument, ret);
	if (r == 0)
		r = take_rest(&input, ret);
	*ret_used = (size_t)(input.at - bytes);
	return r;
}
