/* SPDX-License-Identifier: MIT */
/*
 * Bytes that claim to be an encoded payload.  The first says which codec, the next four how long the
 * payload is; the rest is the code.  What is decoded may be refused, but never written outside.
 */
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "formats/codec/codec.h"
#include "formats/store/payload.h"

#define PAYLOAD_BYTES_MAX (1u << 20)
#define HEAD_BYTES        5u

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size_bytes);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size_bytes)
{
	struct codec_scratch *scratch;
	uint32_t payload_bytes;
	uint8_t *payload;
	uint8_t *code;

	if (size_bytes < HEAD_BYTES)
		return 0;
	memcpy(&payload_bytes, data + 1, sizeof(payload_bytes));
	payload_bytes = payload_bytes % PAYLOAD_BYTES_MAX / 16 * 16;
	payload = aligned_alloc(16, payload_bytes + 16);
	code = malloc(size_bytes - HEAD_BYTES + 1);
	if (!payload || !code || codec_scratch_create(&scratch) < 0)
		abort();
	memcpy(code, data + HEAD_BYTES, size_bytes - HEAD_BYTES);
	if (codec_decode(scratch, data[0] % STORE_CODEC_COUNT_, code, size_bytes - HEAD_BYTES,
			 payload, payload_bytes, NULL) == 0)
		(void)payload_validate(payload, payload_bytes, NULL, NULL);
	codec_scratch_destroy(scratch);
	free(code);
	free(payload);
	return 0;
}
