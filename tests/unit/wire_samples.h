/* SPDX-License-Identifier: MIT */
/**
 * wire_samples.h - one sound message of each type, with a different value in each field, for tests
 * and as the fuzzer's first corpus.
 */
#ifndef TESTS_UNIT_WIRE_SAMPLES_H
#define TESTS_UNIT_WIRE_SAMPLES_H

#include "libclient/wire.h"

#define WIRE_SAMPLE_COUNT 19u

struct wire_sample {
	enum wire_side side;
	size_t fd_count;
	size_t bytes;
	struct wire_header *header; /* of message */
	void *message;              /* static: good until the next one is made */
};

void wire_sample_make(size_t index, struct wire_sample *ret);

#endif /* TESTS_UNIT_WIRE_SAMPLES_H */
