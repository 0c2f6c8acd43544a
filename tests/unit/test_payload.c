/* SPDX-License-Identifier: MIT */
/* Goal: payload.h: what is written is valid and comes back; what cannot be drawn is refused. */
#include <errno.h>
#include <math.h>
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
#include "formats/store/payload.h"
#include "tests/helper.h"

#define PAYLOAD_ROOM 4096

/* Two runs: a quad of two triangles, and one triangle. */
static const struct payload_run runs[] = {
	{ .part = 7, .section = 1, .first_triangle = 0, .colour = 0xff0000ff },
	{ .part = 9, .section = 2, .first_triangle = 2, .colour = 0xff00ff00 },
};
static const uint32_t indices[] = { 0, 1, 2, 2, 1, 3, 4, 5, 6 };
static const uint16_t positions16[7][4] = {
	{ 0, 0, 0, 0 },   { 9, 0, 0, 0 },     { 0, 9, 0, 0 },         { 9, 9, 0, 0 },
	{ 0, 0, 500, 1 }, { 65535, 0, 5, 1 }, { 0, 65535, 65535, 1 },
};
static const struct {
	float xyz[3];
	uint32_t run;
} positions32[7] = {
	{ { 0, 0, 0 }, 0 },
	{ { 9.5f, 0, 0 }, 0 },
	{ { 0, 9, 0 }, 0 },
	{ { 9, 9, -0.0f }, 0 },
	{ { 0, 0, 1e30f }, 1 },
	{ { 1e-30f, 0, 5 }, 1 },
	{ { 0, -16777215.0f, 0 }, 1 },
};
static const int8_t normals[7][2] = { { 1, 2 }, { 3, 4 } };
static const uint32_t colours[7] = { 0x11223344, 0x55667788 };
static const uint64_t triangle_ids[3] = { UINT64_MAX, 0, 1 };

static struct payload_content make_content(void)
{
	return (struct payload_content){
		.payload_id = 42,
		.kind = STORE_KIND_TRIANGLES,
		.vertex_count = 7,
		.triangle_count = 3,
		.run_count = 2,
		.position_format = PAYLOAD_U16X3_RUN,
		.normal_format = PAYLOAD_OCT8,
		.origin = { 1, -2, 1e7 },
		.scale = 0.125,
		.runs = runs,
		.indices = indices,
		.positions = positions16,
	};
}

static uint32_t write_payload(const struct payload_content *content, void *payload)
{
	uint32_t payload_bytes;

	assert_int_equal(payload_size(content, &payload_bytes), 0);
	assert_true(payload_bytes <= PAYLOAD_ROOM);
	payload_write(content, payload);
	return payload_bytes;
}

static void what_is_written_is_valid_and_comes_back(void **state)
{
	_Alignas(256) uint8_t payload[PAYLOAD_ROOM];

	(void)state;
	for (unsigned i = 0; i < 16; i++) {
		struct payload_content content = make_content();
		struct payload_view view;
		struct why why;
		uint32_t payload_bytes;

		if (i & 1) {
			content.position_format = PAYLOAD_F32X3_RUN;
			content.positions = positions32;
		}
		content.normals = i & 2 ? normals : NULL;
		content.colours = i & 4 ? colours : NULL;
		content.triangle_ids = i & 8 ? triangle_ids : NULL;
		memset(payload, 0xaa, sizeof(payload));
		payload_bytes = write_payload(&content, payload);
		if (payload_validate(payload, payload_bytes, NULL, &why) < 0)
			fail_msg("%s", why.text);
		payload_view(payload, &view);
		assert_memory_equal(view.runs, runs, sizeof(runs));
		assert_int_equal(view.index_format, PAYLOAD_U16);
		for (uint32_t k = 0; k < 9; k++)
			assert_int_equal(payload_index(&view, k / 3, k % 3), indices[k]);
		assert_memory_equal(view.positions, content.positions, i & 1 ? 7 * 16 : 7 * 8);
		assert_int_equal(view.normals != NULL, (i & 2) != 0);
		assert_int_equal(view.colours != NULL, (i & 4) != 0);
		if (i & 8)
			assert_memory_equal(view.triangle_ids, triangle_ids, sizeof(triangle_ids));
		assert_int_equal(payload_vertex_run(&view, 3), 0);
		assert_int_equal(payload_vertex_run(&view, 4), 1);
		/* What lies behind its end is not touched. */
		assert_int_equal(payload[payload_bytes], 0xaa);
	}
}

static void positions_are_exact(void **state)
{
	_Alignas(256) uint8_t payload[PAYLOAD_ROOM];
	struct payload_content content = make_content();
	struct payload_view view;
	double position[3];

	(void)state;
	(void)write_payload(&content, payload);
	payload_view(payload, &view);
	payload_position(&view, 6, position);
	assert_true(position[0] == 1 && position[1] == -2 + 65535 * 0.125 &&
		    position[2] == 1e7 + 65535 * 0.125);

	content.position_format = PAYLOAD_F32X3_RUN;
	content.positions = positions32;
	content.scale = 1;
	memset(content.origin, 0, sizeof(content.origin));
	(void)write_payload(&content, payload);
	payload_view(payload, &view);
	for (uint32_t i = 0; i < 7; i++) {
		payload_position(&view, i, position);
		for (unsigned axis = 0; axis < 3; axis++) {
			float back = (float)position[axis];

			/* All bits, also those of -0. */
			assert_memory_equal(&back, &positions32[i].xyz[axis], sizeof(back));
		}
	}
}

static void wide_indices_are_used_above_65536_vertices(void **state)
{
	static const struct payload_run run = { .part = 1 };
	const uint32_t corners[] = { 0, 65536, 65535 };
	struct payload_content content = make_content();
	struct payload_view view;
	uint32_t payload_bytes;
	void *positions;
	void *payload;

	(void)state;
	content.vertex_count = 65537;
	content.triangle_count = 1;
	content.run_count = 1;
	content.runs = &run;
	content.indices = corners;
	positions = calloc(content.vertex_count, 8);
	content.positions = positions;
	assert_int_equal(payload_size(&content, &payload_bytes), 0);
	payload = aligned_alloc(256, bytes_round_up(payload_bytes, 256));
	assert_non_null(payload);
	payload_write(&content, payload);
	assert_int_equal(payload_validate(payload, payload_bytes, NULL, NULL), 0);
	payload_view(payload, &view);
	assert_int_equal(view.index_format, PAYLOAD_U32);
	assert_int_equal(payload_index(&view, 0, 1), 65536);
	free(payload);
	free(positions);
}

static void a_payload_above_the_limit_is_refused(void **state)
{
	struct payload_content content = make_content();
	uint32_t payload_bytes = 77;

	(void)state;
	content.vertex_count = STORE_PAYLOAD_BYTES_MAX / 8;
	assert_int_equal(payload_size(&content, &payload_bytes), -EOVERFLOW);
	content.vertex_count = UINT32_MAX;
	content.triangle_count = UINT32_MAX;
	content.run_count = UINT32_MAX;
	assert_int_equal(payload_size(&content, &payload_bytes), -EOVERFLOW);
	assert_int_equal(payload_bytes, 77);
}

/* ---- refusals ---- */

/** A payload with every stream, as its parts. */
struct payload_bytes {
	struct payload_header *header;
	struct payload_run *runs;
	uint16_t *indices;
	uint16_t (*positions)[4];
	uint8_t *bytes;
};

/* clang-format off */
#define CASE(name, body)                                                                           \
	static void name(struct payload_bytes *payload)                                            \
	{                                                                                          \
		body;                                                                              \
	}

CASE(wrong_magic, payload->header->magic++)
CASE(other_kind, payload->header->kind = STORE_KIND_VOXELS)
CASE(no_kind, payload->header->kind = STORE_KIND_NONE)
CASE(no_id, payload->header->payload_id = 0)
CASE(other_length, payload->header->payload_bytes += 16)
CASE(no_vertices, payload->header->vertex_count = 0)
CASE(no_triangles, payload->header->triangle_count = 0)
CASE(huge_triangles, payload->header->triangle_count = UINT32_MAX)
CASE(huge_vertices, payload->header->vertex_count = UINT32_MAX)
CASE(no_runs, payload->header->run_count = 0)
CASE(more_runs_than_triangles, payload->header->run_count = 4)
CASE(runs_elsewhere, payload->header->runs_offset_bytes = 512)
CASE(nan_origin, payload->header->origin[2] = NAN)
CASE(odd_scale, payload->header->scale = 3)
CASE(negative_scale, payload->header->scale = -1)
CASE(infinite_scale, payload->header->scale = INFINITY)
CASE(used_reserve, payload->header->reserved[119] = 1)
CASE(used_reserve0, payload->header->reserved0 = 1)
CASE(nine_streams, payload->header->stream_count = 9)
CASE(no_streams, payload->header->stream_count = 0)
CASE(one_stream_fewer, payload->header->stream_count--)
CASE(unknown_format, payload->header->streams[0].format = 9)
CASE(no_format, payload->header->streams[0].format = 0)
CASE(foreign_format, payload->header->streams[1].format = PAYLOAD_OCT16)
CASE(wrong_element, payload->header->streams[0].element_bytes = 4)
CASE(stream_twice, payload->header->streams[1] = payload->header->streams[0])
CASE(stream_outside, payload->header->streams[4].offset_bytes = UINT32_MAX - 255)
CASE(stream_in_header, payload->header->streams[0].offset_bytes = 0)
CASE(stream_over_other, payload->header->streams[2].offset_bytes =
				payload->header->streams[1].offset_bytes)
CASE(first_run_late, payload->runs[0].first_triangle = 1)
CASE(run_twice, payload->runs[1].first_triangle = 0)
CASE(run_outside, payload->runs[1].first_triangle = 3)
CASE(index_outside, payload->indices[4] = 7)
CASE(index_of_other_run, payload->indices[0] = 4)
CASE(vertex_of_no_run, payload->positions[6][3] = 2)
CASE(unused_vertex_of_no_run, (payload->positions[6][3] = 2, payload->indices[8] = 5))
CASE(vertices_out_of_order, payload->positions[0][3] = 1)
CASE(dirty_pad, payload->bytes[payload->header->streams[1].offset_bytes - 1] = 1)
CASE(dirty_end, payload->bytes[payload->header->payload_bytes - 1] = 1)
/* clang-format on */

static const struct {
	const char *reason;
	void (*change)(struct payload_bytes *payload);
} refusals[] = {
	{ "magic", wrong_magic },
	{ "kind 4", other_kind },
	{ "kind 0", no_kind },
	{ "id is 0", no_id },
	{ "says", other_length },
	{ "0 vertices", no_vertices },
	{ "0 triangles", no_triangles },
	{ "at byte", huge_triangles },
	{ "16-bit indices", huge_vertices },
	{ "in 0 runs", no_runs },
	{ "in 4 runs", more_runs_than_triangles },
	{ "behind the header", runs_elsewhere },
	{ "not finite", nan_origin },
	{ "power of two", odd_scale },
	{ "power of two", negative_scale },
	{ "power of two", infinite_scale },
	{ "reserved", used_reserve },
	{ "reserved", used_reserve0 },
	{ "9 streams", nine_streams },
	{ "no indices", no_streams },
	{ "unused streams", one_stream_fewer },
	{ "unknown", unknown_format },
	{ "unknown", no_format },
	{ "cannot be of", foreign_format },
	{ "cannot be of", wrong_element },
	{ "in order", stream_twice },
	{ "at byte", stream_outside },
	{ "at byte", stream_in_header },
	{ "at byte", stream_over_other },
	{ "run 0 begins", first_run_late },
	{ "run 1 begins", run_twice },
	{ "run 1 begins", run_outside },
	{ "run 0 has", index_outside },
	{ "run 0 has", index_of_other_run },
	{ "run 1 has", vertex_of_no_run },
	{ "out of order", unused_vertex_of_no_run },
	{ "run 0 has", vertices_out_of_order },
	{ "pad", dirty_pad },
	{ "pad", dirty_end },
};

static void what_cannot_be_drawn_is_refused_with_the_reason(void **state)
{
	struct payload_content content = make_content();
	_Alignas(256) uint8_t bytes[PAYLOAD_ROOM];

	(void)state;
	content.normals = normals;
	content.colours = colours;
	content.triangle_ids = triangle_ids;
	for (size_t i = 0; i < ARRAY_LENGTH(refusals); i++) {
		uint32_t payload_bytes = write_payload(&content, bytes);
		struct payload_bytes payload = { .header = (void *)bytes, .bytes = bytes };
		struct why why = { "" };
		int r;

		payload.runs = (void *)(bytes + 256);
		payload.indices = (void *)(bytes + payload.header->streams[0].offset_bytes);
		payload.positions = (void *)(bytes + payload.header->streams[1].offset_bytes);
		refusals[i].change(&payload);
		r = payload_validate(bytes, payload_bytes, NULL, &why);
		if (r != -EUCLEAN || !strstr(why.text, refusals[i].reason))
			fail_msg("%zu: \"%s\" was expected: %d, %s", i, refusals[i].reason, r,
				 why.text);
	}
}

static void a_position_that_is_not_finite_is_refused(void **state)
{
	struct payload_content content = make_content();
	_Alignas(256) uint8_t bytes[PAYLOAD_ROOM];
	const struct payload_header *header = (void *)bytes;
	float nan = NAN;
	uint32_t payload_bytes;

	(void)state;
	content.position_format = PAYLOAD_F32X3_RUN;
	content.positions = positions32;
	payload_bytes = write_payload(&content, bytes);
	memcpy(bytes + header->streams[1].offset_bytes + 6 * 16 + 8, &nan, sizeof(nan));
	assert_int_equal(payload_validate(bytes, payload_bytes, NULL, NULL), -EUCLEAN);
}

static void a_payload_that_is_not_the_nodes_is_refused(void **state)
{
	struct payload_content content = make_content();
	_Alignas(256) uint8_t bytes[PAYLOAD_ROOM];
	struct store_node node = {
		.payload_id = 42,
		.kind = STORE_KIND_TRIANGLES,
		.vertex_count = 7,
		.triangle_count = 3,
	};
	struct store_node other;

	(void)state;
	node.payload_bytes = write_payload(&content, bytes);
	assert_int_equal(payload_validate(bytes, node.payload_bytes, &node, NULL), 0);
	other = node;
	other.payload_id++;
	assert_int_equal(payload_validate(bytes, node.payload_bytes, &other, NULL), -EUCLEAN);
	other = node;
	other.triangle_count--;
	assert_int_equal(payload_validate(bytes, node.payload_bytes, &other, NULL), -EUCLEAN);
	other = node;
	other.vertex_count++;
	assert_int_equal(payload_validate(bytes, node.payload_bytes, &other, NULL), -EUCLEAN);
}

/* ---- octahedral vectors, Morton numbers ---- */

static double angle_degrees(const float a[3], const float b[3])
{
	double cross[3] = {
		(double)a[1] * b[2] - (double)a[2] * b[1],
		(double)a[2] * b[0] - (double)a[0] * b[2],
		(double)a[0] * b[1] - (double)a[1] * b[0],
	};
	double dot = (double)a[0] * b[0] + (double)a[1] * b[1] + (double)a[2] * b[2];

	return atan2(sqrt(cross[0] * cross[0] + cross[1] * cross[1] + cross[2] * cross[2]), dot) *
	       57.29577951308232;
}

static void octahedral_vectors_come_back_within_their_bound(void **state)
{
	double worst8 = 0;
	double worst16 = 0;

	(void)state;
	for (unsigned i = 0; i < 200000; i++) {
		/* A spiral over the sphere: evenly spread, no random numbers. */
		double z = 1 - 2 * (i + 0.5) / 200000;
		double r = sqrt(1 - z * z);
		const float normal[3] = { (float)(r * cos(i * 2.399963)),
					  (float)(r * sin(i * 2.399963)), (float)z };
		int16_t coded16[2];
		int8_t coded8[2];
		float back[3];

		payload_encode_oct16(normal, coded16);
		payload_decode_oct16(coded16, back);
		worst16 = fmax(worst16, angle_degrees(normal, back));
		payload_encode_oct8(normal, coded8);
		payload_decode_oct8(coded8, back);
		worst8 = fmax(worst8, angle_degrees(normal, back));
	}
	/* As the survey measured them. */
	assert_true(worst16 < 0.004);
	assert_true(worst8 < 0.7);
}

static void octahedral_axes_are_exact_and_nonsense_is_up(void **state)
{
	const float nonsense[][3] = { { 0, 0, 0 }, { NAN, 0, 0 }, { INFINITY, 0, 0 } };

	(void)state;
	for (unsigned i = 0; i < 6; i++) {
		float normal[3] = { 0 };
		int16_t coded16[2];
		int8_t coded8[2];
		float back[3];

		normal[i / 2] = i % 2 ? 1.0f : -1.0f;
		payload_encode_oct16(normal, coded16);
		payload_decode_oct16(coded16, back);
		assert_true(angle_degrees(normal, back) == 0);
		payload_encode_oct8(normal, coded8);
		payload_decode_oct8(coded8, back);
		assert_true(angle_degrees(normal, back) == 0);
	}
	for (size_t i = 0; i < ARRAY_LENGTH(nonsense); i++) {
		int16_t coded16[2] = { 1, 1 };
		int8_t coded8[2] = { 1, 1 };

		payload_encode_oct16(nonsense[i], coded16);
		payload_encode_oct8(nonsense[i], coded8);
		assert_int_equal(coded16[0] | coded16[1] | coded8[0] | coded8[1], 0);
	}
}

static void morton_numbers_interleave_the_bits(void **state)
{
	const uint32_t most = (UINT32_C(1) << STORE_LEVEL_MAX) - 1;

	(void)state;
	assert_int_equal(store_morton(0, 0, 0), 0);
	assert_int_equal(store_morton(1, 0, 0), 1);
	assert_int_equal(store_morton(0, 1, 0), 2);
	assert_int_equal(store_morton(0, 0, 1), 4);
	assert_true(store_morton(most, most, most) == (UINT64_C(1) << 63) - 1);
	for (uint32_t bit = 0; bit < STORE_LEVEL_MAX; bit++) {
		assert_true(store_morton(1u << bit, 0, 0) == UINT64_C(1) << (3 * bit));
		assert_true(store_morton(0, 1u << bit, 0) == UINT64_C(2) << (3 * bit));
		assert_true(store_morton(0, 0, 1u << bit) == UINT64_C(4) << (3 * bit));
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(what_is_written_is_valid_and_comes_back),
		cmocka_unit_test(positions_are_exact),
		cmocka_unit_test(wide_indices_are_used_above_65536_vertices),
		cmocka_unit_test(a_payload_above_the_limit_is_refused),
		cmocka_unit_test(what_cannot_be_drawn_is_refused_with_the_reason),
		cmocka_unit_test(a_position_that_is_not_finite_is_refused),
		cmocka_unit_test(a_payload_that_is_not_the_nodes_is_refused),
		cmocka_unit_test(octahedral_vectors_come_back_within_their_bound),
		cmocka_unit_test(octahedral_axes_are_exact_and_nonsense_is_up),
		cmocka_unit_test(morton_numbers_interleave_the_bits),
	};

	return TEST_RUN(tests);
}
