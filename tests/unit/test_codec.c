/* SPDX-License-Identifier: MIT */
/* Goal: codec.h: what is decoded is what was encoded; damaged codes are errors, never a write outside. */
#include <errno.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "formats/base/bytes.h"
#include "formats/codec/codec.h"
#include "formats/store/payload.h"
#include "formats/store/store_file.h"
#include "tests/helper.h"
#include "tests/store_image.h"

#define GUARD_BYTES 64
#define GUARD       0xa5

/** The payloads of a store without codec, which is on disk as it is drawn. */
struct payloads {
	char *folder;
	struct store_image image;
	struct codec_scratch *scratch;
};

static int payloads_setup(void **state)
{
	struct payloads *payloads = calloc(1, sizeof(*payloads));
	/* An odd number of vertices, so that the small normals do not fill their last word. */
	const struct test_grid grid = {
		.count = 3, .face_quads = 2, .normals = true, .colours = true, .triangle_ids = true
	};

	payloads->folder = test_folder_make();
	test_store_grid_make(test_path(payloads->folder, "grid.ooc"), &grid);
	store_image_load(test_path(payloads->folder, "grid.ooc"), &payloads->image);
	assert_int_equal(codec_scratch_create(&payloads->scratch), 0);
	*state = payloads;
	return 0;
}

static int payloads_teardown(void **state)
{
	struct payloads *payloads = *state;

	codec_scratch_destroy(payloads->scratch);
	store_image_done(&payloads->image);
	test_folder_remove(payloads->folder);
	free(payloads);
	return 0;
}

/** A payload encoded, and room to decode it with a guard behind. */
struct coded {
	const struct store_node *node;
	const void *payload;
	uint8_t *stored;
	size_t stored_bytes;
	uint8_t *decoded;
};

static void coded_init(const struct payloads *payloads, uint32_t node_index, enum store_codec codec,
		       struct coded *ret)
{
	size_t bound;

	ret->node = &store_image_nodes(&payloads->image)[node_index];
	ret->payload = store_image_payload(&payloads->image, node_index);
	bound = codec_bound(codec, ret->node->payload_bytes);
	ret->stored = malloc(bound);
	ret->decoded =
		aligned_alloc(16, bytes_round_up(ret->node->payload_bytes + GUARD_BYTES, 16));
	assert_non_null(ret->stored);
	assert_non_null(ret->decoded);
	memset(ret->decoded, GUARD, ret->node->payload_bytes + GUARD_BYTES);
	assert_int_equal(codec_encode(payloads->scratch, codec, 3, ret->payload,
				      ret->node->payload_bytes, ret->stored, bound,
				      &ret->stored_bytes),
			 0);
}

static void coded_done(struct coded *coded)
{
	for (size_t i = 0; i < GUARD_BYTES; i++)
		assert_int_equal(coded->decoded[coded->node->payload_bytes + i], GUARD);
	free(coded->stored);
	free(coded->decoded);
}

/* Corners may have been turned; everything else is the same, byte for byte. */
static void assert_same_but_for_turns(const void *payload, const void *decoded,
				      uint32_t payload_bytes)
{
	struct payload_view before;
	struct payload_view after;
	size_t index_offset;
	size_t index_bytes;

	payload_view(payload, &before);
	payload_view(decoded, &after);
	for (uint32_t i = 0; i < before.header->triangle_count; i++) {
		uint32_t turn = 0;

		while (turn < 3 && payload_index(&after, i, turn) != payload_index(&before, i, 0))
			turn++;
		assert_true(turn < 3);
		for (uint32_t k = 0; k < 3; k++)
			assert_int_equal(payload_index(&after, i, (turn + k) % 3),
					 payload_index(&before, i, k));
	}
	index_offset = before.header->streams[0].offset_bytes;
	index_bytes =
		(size_t)before.header->triangle_count * 3 * before.header->streams[0].element_bytes;
	assert_memory_equal(payload, decoded, index_offset);
	assert_memory_equal((const uint8_t *)payload + index_offset + index_bytes,
			    (const uint8_t *)decoded + index_offset + index_bytes,
			    payload_bytes - index_offset - index_bytes);
}

static void each_codec_gives_back_the_payload(void **state)
{
	struct payloads *payloads = *state;
	uint64_t node_count = store_image_superblock(&payloads->image, 0)->node_count;

	for (uint32_t codec = STORE_CODEC_ZSTD; codec < STORE_CODEC_COUNT_; codec++) {
		for (uint32_t i = 0; i < node_count; i++) {
			struct coded coded;
			struct why why;

			if (store_image_nodes(&payloads->image)[i].payload_id == 0)
				continue;
			coded_init(payloads, i, codec, &coded);
			if (codec_decode(payloads->scratch, codec, coded.stored, coded.stored_bytes,
					 coded.decoded, coded.node->payload_bytes, &why) < 0)
				fail_msg("%s: %s", codec_name(codec), why.text);
			assert_int_equal(payload_validate(coded.decoded, coded.node->payload_bytes,
							  coded.node, NULL),
					 0);
			assert_same_but_for_turns(coded.payload, coded.decoded,
						  coded.node->payload_bytes);
			if (codec == STORE_CODEC_ZSTD)
				assert_memory_equal(coded.payload, coded.decoded,
						    coded.node->payload_bytes);
			coded_done(&coded);
		}
	}
}

static void coding_what_was_decoded_changes_nothing_more(void **state)
{
	struct payloads *payloads = *state;
	struct coded coded;
	uint8_t *again;
	uint8_t *decoded_again;
	size_t bound;
	size_t again_bytes;

	coded_init(payloads, 1, STORE_CODEC_MESHOPT, &coded);
	bound = codec_bound(STORE_CODEC_MESHOPT, coded.node->payload_bytes);
	again = malloc(bound);
	decoded_again = aligned_alloc(16, coded.node->payload_bytes);
	assert_int_equal(codec_decode(payloads->scratch, STORE_CODEC_MESHOPT, coded.stored,
				      coded.stored_bytes, coded.decoded, coded.node->payload_bytes,
				      NULL),
			 0);
	assert_int_equal(codec_encode(payloads->scratch, STORE_CODEC_MESHOPT, 3, coded.decoded,
				      coded.node->payload_bytes, again, bound, &again_bytes),
			 0);
	assert_int_equal(codec_decode(payloads->scratch, STORE_CODEC_MESHOPT, again, again_bytes,
				      decoded_again, coded.node->payload_bytes, NULL),
			 0);
	assert_memory_equal(coded.decoded, decoded_again, coded.node->payload_bytes);
	free(decoded_again);
	free(again);
	coded_done(&coded);
}

static void encoding_is_the_same_every_time_and_fits_the_bound(void **state)
{
	struct payloads *payloads = *state;

	for (uint32_t codec = 0; codec < STORE_CODEC_COUNT_; codec++) {
		struct codec_scratch *other;
		struct coded first;
		uint8_t *second;
		size_t bound;
		size_t second_bytes;

		coded_init(payloads, 2, codec, &first);
		bound = codec_bound(codec, first.node->payload_bytes);
		assert_true(first.stored_bytes <= bound);
		second = malloc(bound);
		assert_non_null(second);
		assert_int_equal(codec_scratch_create(&other), 0);
		assert_int_equal(codec_encode(other, codec, 3, first.payload,
					      first.node->payload_bytes, second, bound,
					      &second_bytes),
				 0);
		assert_int_equal(second_bytes, first.stored_bytes);
		assert_memory_equal(first.stored, second, second_bytes);
		codec_scratch_destroy(other);
		free(second);
		coded_done(&first);
	}
}

static void too_little_room_is_said(void **state)
{
	struct payloads *payloads = *state;

	for (uint32_t codec = 0; codec < STORE_CODEC_COUNT_; codec++) {
		struct coded coded;
		size_t stored_bytes;

		coded_init(payloads, 2, codec, &coded);
		for (size_t room = 0; room < coded.stored_bytes; room += 97)
			assert_int_equal(codec_encode(payloads->scratch, codec, 3, coded.payload,
						      coded.node->payload_bytes, coded.stored, room,
						      &stored_bytes),
					 -ENOBUFS);
		coded_done(&coded);
	}
}

static void codes_that_were_cut_or_changed_are_errors_or_harmless(void **state)
{
	struct payloads *payloads = *state;

	for (uint32_t codec = STORE_CODEC_ZSTD; codec < STORE_CODEC_COUNT_; codec++) {
		struct coded coded;
		struct why why;

		coded_init(payloads, 1, codec, &coded);
		for (size_t length = 0; length < coded.stored_bytes; length += 13)
			assert_int_equal(codec_decode(payloads->scratch, codec, coded.stored,
						      length, coded.decoded,
						      coded.node->payload_bytes, &why),
					 -EUCLEAN);
		for (size_t i = 0; i < coded.stored_bytes * 8; i += 3) {
			coded.stored[i / 8] ^= (uint8_t)(1u << i % 8);
			/* A wrong number is not the codec's to find: the judge of payloads may. */
			if (codec_decode(payloads->scratch, codec, coded.stored, coded.stored_bytes,
					 coded.decoded, coded.node->payload_bytes, NULL) == 0)
				(void)payload_validate(coded.decoded, coded.node->payload_bytes,
						       coded.node, NULL);
			coded.stored[i / 8] ^= (uint8_t)(1u << i % 8);
		}
		/* Another length than the payload's. */
		assert_int_equal(codec_decode(payloads->scratch, codec, coded.stored,
					      coded.stored_bytes, coded.decoded,
					      coded.node->payload_bytes - 16, &why),
				 -EUCLEAN);
		coded_done(&coded);
	}
}

static void something_behind_the_code_is_an_error(void **state)
{
	struct payloads *payloads = *state;

	for (uint32_t codec = STORE_CODEC_ZSTD; codec < STORE_CODEC_COUNT_; codec++) {
		struct coded coded;
		uint8_t *longer;

		coded_init(payloads, 1, codec, &coded);
		longer = calloc(1, coded.stored_bytes + 8);
		memcpy(longer, coded.stored, coded.stored_bytes);
		assert_int_equal(codec_decode(payloads->scratch, codec, longer,
					      coded.stored_bytes + 8, coded.decoded,
					      coded.node->payload_bytes, NULL),
				 -EUCLEAN);
		free(longer);
		coded_done(&coded);
	}
}

static void codecs_have_names(void **state)
{
	(void)state;
	for (uint32_t codec = 0; codec < STORE_CODEC_COUNT_; codec++)
		assert_int_equal(codec_find(codec_name(codec)), codec);
	assert_null(codec_name(STORE_CODEC_COUNT_));
	assert_int_equal(codec_find("zip"), -EINVAL);
	assert_int_equal(codec_find(""), -EINVAL);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(each_codec_gives_back_the_payload),
		cmocka_unit_test(coding_what_was_decoded_changes_nothing_more),
		cmocka_unit_test(encoding_is_the_same_every_time_and_fits_the_bound),
		cmocka_unit_test(too_little_room_is_said),
		cmocka_unit_test(codes_that_were_cut_or_changed_are_errors_or_harmless),
		cmocka_unit_test(something_behind_the_code_is_an_error),
		cmocka_unit_test(codecs_have_names),
	};
	struct test_descriptors before;

	test_descriptors_note(&before);
	return cmocka_run_group_tests(tests, payloads_setup, payloads_teardown) +
	       test_descriptors_leaked(&before);
}
