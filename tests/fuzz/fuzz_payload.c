/* SPDX-License-Identifier: MIT */
/* Bytes that claim to be a decoded payload: those that are judged well can be walked through. */
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/store/payload.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size_bytes);

static void walk(const void *payload)
{
	struct payload_view view;
	volatile double sum = 0;

	payload_view(payload, &view);
	for (uint32_t i = 0; i < view.header->run_count; i++)
		sum = sum + view.runs[i].part;
	for (uint32_t i = 0; i < view.header->triangle_count; i++) {
		for (uint32_t k = 0; k < 3; k++) {
			uint32_t vertex = payload_index(&view, i, k);
			double position[3];

			payload_position(&view, vertex, position);
			sum = sum + position[2] + view.runs[payload_vertex_run(&view, vertex)].part;
			if (view.colours)
				sum = sum + view.colours[(size_t)vertex * 4 + 3];
		}
		if (view.triangle_ids)
			sum = sum + (double)view.triangle_ids[i];
	}
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size_bytes)
{
	/* Exactly as long as the input: reading past its end is then seen. */
	uint8_t *payload = aligned_alloc(16, bytes_round_up(size_bytes + 1, 16));
	struct payload_header *header = (void *)payload;
	size_t exact = size_bytes / 16 * 16;

	if (!payload)
		abort();
	memcpy(payload, data, size_bytes);
	if (payload_validate(payload, exact, NULL, NULL) == 0)
		walk(payload);
	/* Most changes spoil the length; the judges behind it shall be reached, too. */
	if (exact >= sizeof(*header)) {
		header->payload_bytes = (uint32_t)exact;
		if (payload_validate(payload, exact, NULL, NULL) == 0)
			walk(payload);
	}
	free(payload);
	return 0;
}
