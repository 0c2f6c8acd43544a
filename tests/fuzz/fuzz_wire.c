/* SPDX-License-Identifier: MIT */
/*
 * Any bytes as a message from either side: what wire_check() passes may be read where it lies.
 *
 * The first byte says the side (bit 0) and the number of descriptors; the message is the rest.
 */
#include <stdlib.h>
#include <string.h>

#include "formats/base/check.h"
#include "libclient/wire.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size_bytes);

/* Reads what a receiver would read after the check, to its last byte. */
static uint64_t entries_sum(const struct wire_entry *entries, uint32_t entry_count)
{
	uint64_t sum = 0;

	for (uint32_t i = 0; i < entry_count; i++) {
		CHECK(entries[i].store < WIRE_STORE_COUNT_MAX);
		CHECK(entries[i].importance >= 0.0f);
		sum += entries[i].node;
	}
	return sum;
}

static uint64_t message_sum(const struct wire_header *header)
{
	const struct wire_set *set = (const void *)header;
	const struct wire_prefetch *prefetch = (const void *)header;
	const struct wire_not_now *not_now = (const void *)header;
	const struct wire_text *text = (const void *)header;
	const struct wire_admin *admin = (const void *)header;
	const struct wire_nodes *nodes = (const void *)header;
	uint64_t sum = 0;

	switch (header->type) {
	case WIRE_HELLO:
		if (((const struct wire_hello *)(const void *)header)->version != WIRE_VERSION)
			return 0;
		return strlen(((const struct wire_hello *)(const void *)header)->name);
	case WIRE_OPEN:
		return strlen(((const struct wire_open *)(const void *)header)->path);
	case WIRE_ERROR:
		return strlen(((const struct wire_error *)(const void *)header)->text);
	case WIRE_SET:
		return entries_sum(set->entries, set->entry_count);
	case WIRE_PREFETCH:
		return entries_sum(prefetch->entries, prefetch->entry_count);
	case WIRE_NOT_NOW:
		for (uint32_t i = 0; i < not_now->entry_count; i++) {
			CHECK(not_now->entries[i].reason < WIRE_REASON_COUNT_);
			sum += not_now->entries[i].node;
		}
		return sum;
	case WIRE_ADMIN:
		for (uint32_t i = 0; i < admin->node_count; i++)
			sum += admin->nodes[i];
		return sum;
	case WIRE_NODES:
		for (uint32_t i = 0; i < nodes->entry_count; i++) {
			CHECK(nodes->entries[i].cached < WIRE_CACHED_COUNT_);
			sum += nodes->entries[i].holds;
		}
		return sum;
	case WIRE_TEXT:
		for (uint32_t i = 0; i < text->text_bytes; i++)
			sum += (uint8_t)text->text[i];
		return sum;
	default:
		return 0;
	}
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size_bytes)
{
	volatile uint64_t sink = 0;
	struct why why = { "" };
	size_t message_bytes;
	void *message;
	int r;

	if (size_bytes == 0)
		return 0;
	/* A copy of just that length: a read behind it is seen by AddressSanitizer. */
	message_bytes = size_bytes - 1;
	message = malloc(message_bytes > 0 ? message_bytes : 1);
	if (!message)
		return 0;
	memcpy(message, data + 1, message_bytes);
	r = wire_check((data[0] & 1) ? WIRE_FROM_DAEMON : WIRE_FROM_CLIENT, message, message_bytes,
		       data[0] >> 1, &why);
	CHECK((r == 0) == (why.text[0] == '\0'));
	if (r == 0)
		sink = sink + message_sum(message);
	free(message);
	return 0;
}
