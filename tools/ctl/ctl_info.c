/* SPDX-License-Identifier: MIT */
#include <getopt.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/log.h"
#include "formats/base/text.h"
#include "formats/codec/codec.h"
#include "formats/store/payload.h"
#include "tools/ctl/ctl.h"

/** Payloads that are looked into for what their bytes are: enough to be sure of a per cent. */
#define PAYLOADS_READ_MAX 512u

/** What a decoded payload's bytes are. */
enum spent {
	SPENT_INDICES,
	SPENT_POSITIONS,
	SPENT_NORMALS,
	SPENT_COLOURS,
	SPENT_TRIANGLE_IDS,
	SPENT_HEADERS, /* and runs and pads */
	SPENT_COUNT_,
};

static const char *const spent_names[SPENT_COUNT_] = {
	"indices", "positions", "normals", "colours", "triangle_ids", "headers_and_runs",
};

/** Everything that is printed, measured once. */
struct info {
	const char *path;
	struct ctl_store store;
	uint64_t codec_counts[STORE_CODEC_COUNT_];
	uint64_t inner_payloads;
	uint64_t pad_bytes;
	uint64_t payloads_read;
	uint64_t spent[SPENT_COUNT_]; /* decoded bytes of the payloads read */
	uint64_t spent_total;
};

static const char help[] =
	"Usage: oocctl info STORE [--json]\n"
	"Says what a store holds, and what its bytes were spent on: up to 512 payloads, evenly\n"
	"spread, are read for it.\n"
	"\n"
	"      --json   one object in place of lines\n"
	"      --help   this text\n"
	"\n"
	"Example:\n"
	"  oocctl info plant.ooc";

/* ---- measuring ---- */

static void look_into(struct info *info, const struct payload_header *header)
{
	static const enum spent spent_of[PAYLOAD_SEMANTIC_COUNT_] = {
		[PAYLOAD_INDEX] = SPENT_INDICES,
		[PAYLOAD_POSITION] = SPENT_POSITIONS,
		[PAYLOAD_NORMAL] = SPENT_NORMALS,
		[PAYLOAD_COLOUR] = SPENT_COLOURS,
		[PAYLOAD_TRIANGLE_ID] = SPENT_TRIANGLE_IDS,
	};
	uint64_t rest = header->payload_bytes;

	for (unsigned i = 0; i < header->stream_count; i++) {
		const struct payload_stream *stream = &header->streams[i];
		uint64_t bytes =
			payload_stream_elements(header, stream->semantic) * stream->element_bytes;

		info->spent[spent_of[stream->semantic]] += bytes;
		rest -= bytes;
	}
	info->spent[SPENT_HEADERS] += rest;
	info->spent_total += header->payload_bytes;
	info->payloads_read++;
}

static int read_payloads(struct info *info)
{
	const struct ctl_store *store = &info->store;
	uint64_t node_count = store->superblock->node_count;
	uint64_t stride = node_count / PAYLOADS_READ_MAX + 1;
	struct ctl_payload payload;
	struct why why;

	if (ctl_payload_init(&payload, store) < 0)
		return CTL_FAILED;
	/* From the end: leaves are the last, and nearly all of the bytes. */
	for (uint64_t i = 0; i < node_count; i += stride) {
		const struct store_node *node = &store->nodes[node_count - 1 - i];

		if (node->payload_id == 0)
			continue;
		if (store_read_payload(store->file, node, payload.decoded, payload.stored, &why) <
		    0) {
			log_error("%s: node %" PRIu64
				  ": %s: `oocctl verify` names all that is damaged",
				  info->path, node_count - 1 - i, why.text);
			ctl_payload_done(&payload);
			return CTL_FAILED;
		}
		look_into(info, payload.decoded);
	}
	ctl_payload_done(&payload);
	return CTL_OK;
}

static void count_records(struct info *info)
{
	for (uint64_t i = 0; i < info->store.superblock->node_count; i++) {
		const struct store_node *node = &info->store.nodes[i];

		if (node->payload_id == 0)
			continue;
		info->codec_counts[node->codec]++;
		info->inner_payloads += node->child_count > 0;
		info->pad_bytes +=
			bytes_round_up(node->stored_bytes, STORE_BLOCK_BYTES) - node->stored_bytes;
	}
}

/* ---- printing ---- */

static double per_triangle(const struct info *info, double bytes)
{
	uint64_t triangles = info->store.superblock->triangle_count;

	return triangles ? bytes / (double)triangles : 0;
}

static void print_line(const struct info *info, const char *name, uint64_t bytes)
{
	char size[TEXT_SIZE_BYTES];

	printf("  %-20s %12s %9.3f bytes/triangle %6.2f %%\n", name, text_from_size(bytes, size),
	       per_triangle(info, (double)bytes),
	       100.0 * (double)bytes / (double)info->store.superblock->file_bytes);
}

static void print_uuid(const struct store_superblock *superblock)
{
	for (size_t i = 0; i < sizeof(superblock->uuid); i++)
		printf("%s%02x", i == 4 || i == 6 || i == 8 || i == 10 ? "-" : "",
		       superblock->uuid[i]);
}

static void print_model(const struct info *info)
{
	const struct store_superblock *superblock = info->store.superblock;
	static const char *const axes[STORE_AXIS_COUNT_] = { "unknown", "X", "Y", "Z" };
	static const char *const layouts[STORE_LAYOUT_COUNT_] = { "unique", "replicate" };

	printf("%s: ", info->path);
	print_uuid(superblock);
	printf(", generation %" PRIu64 ", made by %s\n", superblock->generation,
	       (const char *)superblock->producer);
	printf("triangles  %" PRIu64 " of %" PRIu64 " in the model, %" PRIu64 " vertices\n",
	       superblock->triangle_count, superblock->triangles_in, superblock->vertex_count);
	printf("nodes      %" PRIu64 ", %" PRIu64 " leaves, %u levels, %" PRIu64
	       " coarser payloads, layout %s\n",
	       superblock->node_count, superblock->leaf_count, superblock->level_max + 1,
	       info->inner_payloads, layouts[superblock->layout]);
	printf("parts      %" PRIu64 " in %" PRIu64 " sections\n", superblock->part_count,
	       superblock->section_count);
	printf("box        %.10g,%.10g,%.10g to %.10g,%.10g,%.10g\n",
	       superblock->origin[0] + superblock->box_min[0],
	       superblock->origin[1] + superblock->box_min[1],
	       superblock->origin[2] + superblock->box_min[2],
	       superblock->origin[0] + superblock->box_max[0],
	       superblock->origin[1] + superblock->box_max[1],
	       superblock->origin[2] + superblock->box_max[2]);
	if (superblock->unit_metres > 0)
		printf("unit       %g m, up axis %s\n", superblock->unit_metres,
		       axes[superblock->up_axis]);
	else
		printf("unit       unknown, up axis %s\n", axes[superblock->up_axis]);
	if (superblock->step_exponent == STORE_STEP_NONE)
		printf("error      positions are floats; bound %g, measured %g\n",
		       superblock->error, superblock->error_measured);
	else
		printf("error      step 2^%d; bound %g, measured %g\n", superblock->step_exponent,
		       superblock->error, superblock->error_measured);
}

static void print_bytes(const struct info *info)
{
	const struct store_superblock *superblock = info->store.superblock;

	printf("bytes of the file\n");
	print_line(info, "payloads", superblock->payload_stored_bytes);
	print_line(info, "pads behind payloads", info->pad_bytes);
	print_line(info, "HS", superblock->hs.stored_bytes);
	print_line(info, "names", superblock->names.stored_bytes);
	print_line(info, "all", superblock->file_bytes);
	fputs("codecs    ", stdout);
	for (uint32_t codec = 0; codec < STORE_CODEC_COUNT_; codec++)
		if (info->codec_counts[codec] > 0)
			printf(" %s %" PRIu64, codec_name(codec), info->codec_counts[codec]);
	printf("\nbytes of decoded payloads, as %" PRIu64 " of them say\n", info->payloads_read);
	for (unsigned i = 0; i < SPENT_COUNT_; i++) {
		double share =
			info->spent_total ? (double)info->spent[i] / (double)info->spent_total : 0;

		printf("  %-20s %22.3f bytes/triangle %6.2f %%\n", spent_names[i],
		       per_triangle(info, share * (double)superblock->payload_raw_bytes),
		       100.0 * share);
	}
}

static void print_json_vector(const char *name, const double values[3])
{
	printf("  \"%s\": [%.17g, %.17g, %.17g],\n", name, values[0], values[1], values[2]);
}

static void print_json(const struct info *info)
{
	const struct store_superblock *superblock = info->store.superblock;

	fputs("{\n  \"store\": ", stdout);
	text_write_json(stdout, info->path);
	fputs(",\n  \"uuid\": \"", stdout);
	print_uuid(superblock);
	fputs("\",\n  \"producer\": ", stdout);
	text_write_json(stdout, (const char *)superblock->producer);
	printf(",\n  \"generation\": %" PRIu64 ",\n  \"triangles_in\": %" PRIu64
	       ",\n  \"triangles\": %" PRIu64 ",\n  \"vertices\": %" PRIu64
	       ",\n  \"nodes\": %" PRIu64 ",\n  \"leaves\": %" PRIu64
	       ",\n  \"level_max\": %u,\n  \"parts\": %" PRIu64 ",\n  \"sections\": %" PRIu64 ",\n",
	       superblock->generation, superblock->triangles_in, superblock->triangle_count,
	       superblock->vertex_count, superblock->node_count, superblock->leaf_count,
	       superblock->level_max, superblock->part_count, superblock->section_count);
	print_json_vector("origin", superblock->origin);
	print_json_vector("box_min", superblock->box_min);
	print_json_vector("box_max", superblock->box_max);
	printf("  \"unit_metres\": %.17g,\n  \"up_axis\": %u,\n  \"error\": %.17g,\n"
	       "  \"error_measured\": %.17g,\n",
	       superblock->unit_metres, superblock->up_axis, superblock->error,
	       superblock->error_measured);
	if (superblock->step_exponent == STORE_STEP_NONE)
		fputs("  \"step\": null,\n", stdout);
	else
		printf("  \"step\": %.17g,\n", ldexp(1, superblock->step_exponent));
	printf("  \"bytes\": {\"file\": %" PRIu64 ", \"payloads\": %" PRIu64 ", \"pads\": %" PRIu64
	       ", \"hs\": %" PRIu64 ", \"names\": %" PRIu64 ", \"decoded\": %" PRIu64
	       ", \"largest_payload\": %u},\n  \"codecs\": {",
	       superblock->file_bytes, superblock->payload_stored_bytes, info->pad_bytes,
	       superblock->hs.stored_bytes, superblock->names.stored_bytes,
	       superblock->payload_raw_bytes, superblock->payload_bytes_max);
	for (uint32_t codec = 0; codec < STORE_CODEC_COUNT_; codec++)
		printf("%s\"%s\": %" PRIu64, codec ? ", " : "", codec_name(codec),
		       info->codec_counts[codec]);
	printf("},\n  \"decoded_share\": {");
	for (unsigned i = 0; i < SPENT_COUNT_; i++)
		printf("%s\"%s\": %.6f", i ? ", " : "", spent_names[i],
		       info->spent_total ? (double)info->spent[i] / (double)info->spent_total : 0);
	printf("},\n  \"payloads_read\": %" PRIu64 "\n}\n", info->payloads_read);
}

int ctl_info(int argc, char **argv)
{
	struct info info = { 0 };
	bool json = false;
	int status;

	status = ctl_parse_json(argc, argv, help, &json);
	if (status != CTL_OK)
		return status < 0 ? CTL_OK : status;
	if (argc - optind != 1)
		return ctl_usage("info", "wants one store");
	info.path = argv[optind];
	status = ctl_store_open(info.path, &info.store);
	if (status != CTL_OK)
		return status;
	count_records(&info);
	status = read_payloads(&info);
	if (status == CTL_OK && json) {
		print_json(&info);
	} else if (status == CTL_OK) {
		print_model(&info);
		print_bytes(&info);
	}
	ctl_store_close(&info.store);
	return status;
}
