/* SPDX-License-Identifier: MIT */
#include <errno.h>
#include <getopt.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

#include "formats/base/file.h"
#include "formats/base/log.h"
#include "formats/base/text.h"
#include "formats/codec/codec.h"
#include "formats/store/payload.h"
#include "formats/store/store_hs.h"
#include "tools/ctl/ctl.h"

/** More parts of one damaged node are only counted. */
#define PARTS_SHOWN_MAX 8u

/** Where damage is being told, and what of the store can still be read to tell it better. */
struct report {
	const char *path;
	bool json;
	uint64_t damage_count;
	struct why newest;      /* what was damaged last */
	struct ctl_store store; /* file is NULL where it does not even open */
};

static const char help[] =
	"Usage: oocctl verify STORE [--json]\n"
	"Reads every byte of a store: superblocks, HS, names, payloads and the zeros between.\n"
	"Each damaged node is named, with its box and its parts as far as they can be read.\n"
	"Exit status: 0 whole, 1 damaged or unreadable.\n"
	"\n"
	"      --json   one object in place of lines\n"
	"      --help   this text\n"
	"\n"
	"Example:\n"
	"  oocctl verify plant.ooc --json | jq '.damage[].node'";

/* ---- what a damaged payload held ---- */

static int decode_anyway(const struct ctl_store *store, const struct store_node *node, void *stored,
			 void *decoded)
{
	struct codec_scratch *scratch;
	int r = file_read_at(store_fd(store->file), stored, node->stored_bytes, node->file_offset);

	if (r < 0)
		return r;
	r = codec_scratch_create(&scratch);
	if (r < 0)
		return r;
	r = codec_decode(scratch, node->codec, stored, node->stored_bytes, decoded,
			 node->payload_bytes, NULL);
	codec_scratch_destroy(scratch);
	return r;
}

static void print_part(const struct report *report, const struct payload_run *run, uint32_t number)
{
	const struct store_names *names = &report->store.names;
	const char *name = ctl_string(names, names->parts[run->part].name);

	if (report->json) {
		fputs(number == 0 ? "" : ", ", stdout);
		text_write_json(stdout, name);
	} else {
		printf("%s%s", number == 0 ? "; parts: " : ", ", name);
	}
}

/*
 * Most damage leaves the run table readable.  What it says was not proved by the checksum, so it is
 * shown and relied on for nothing.
 */
static void print_parts_of(const struct report *report, const void *payload, uint32_t payload_bytes)
{
	const struct payload_header *header = payload;
	const struct payload_run *runs;
	uint32_t shown = 0;

	if (payload_validate_header(header, payload_bytes, NULL) < 0)
		return;
	runs = (const void *)((const uint8_t *)payload + header->runs_offset_bytes);
	for (uint32_t i = 0; i < header->run_count && shown < PARTS_SHOWN_MAX; i++)
		if (runs[i].part < report->store.superblock->part_count)
			print_part(report, &runs[i], shown++);
	if (header->run_count > PARTS_SHOWN_MAX && !report->json)
		printf(" and %u more", header->run_count - PARTS_SHOWN_MAX);
}

static void print_parts(const struct report *report, const struct store_node *node)
{
	const struct ctl_store *store = &report->store;
	void *decoded = malloc(node->payload_bytes);
	void *stored = malloc(node->stored_bytes);

	if (decoded && stored && store->names.parts) {
		if (node->codec == STORE_CODEC_NONE) {
			if (file_read_at(store_fd(store->file), decoded, node->payload_bytes,
					 node->file_offset) == 0)
				print_parts_of(report, decoded, node->payload_bytes);
		} else if (decode_anyway(store, node, stored, decoded) == 0) {
			print_parts_of(report, decoded, node->payload_bytes);
		}
	}
	free(stored);
	free(decoded);
}

/* ---- telling ---- */

/* The record of a damaged node; NULL: what is damaged is no node, or the file is changing. */
static const struct store_node *known_node(const struct report *report, uint32_t node_index)
{
	if (!report->store.nodes || node_index >= report->store.superblock->node_count)
		return NULL;
	return &report->store.nodes[node_index];
}

static void print_json_damage(const struct report *report, uint32_t node_index,
			      const struct why *why)
{
	const struct store_node *node = known_node(report, node_index);

	printf("%s\n    {\"node\": ", report->damage_count == 0 ? "" : ",");
	if (!node) {
		fputs("null", stdout);
	} else {
		printf("%u, \"payload_id\": %" PRIu64
		       ", \"box\": [%.9g, %.9g, %.9g, %.9g, %.9g, %.9g]",
		       node_index, node->payload_id, (double)node->box_min[0],
		       (double)node->box_min[1], (double)node->box_min[2], (double)node->box_max[0],
		       (double)node->box_max[1], (double)node->box_max[2]);
		fputs(", \"parts\": [", stdout);
		print_parts(report, node);
		putchar(']');
	}
	fputs(", \"what\": ", stdout);
	text_write_json(stdout, why->text);
	putchar('}');
}

static void print_damage(const struct report *report, uint32_t node_index, const struct why *why)
{
	const struct store_node *node = known_node(report, node_index);

	if (!node) {
		printf("%s\n", why->text);
	} else {
		printf("node %u: %s; box %g,%g,%g to %g,%g,%g from the origin", node_index,
		       why->text, (double)node->box_min[0], (double)node->box_min[1],
		       (double)node->box_min[2], (double)node->box_max[0], (double)node->box_max[1],
		       (double)node->box_max[2]);
		print_parts(report, node);
		putchar('\n');
	}
}

static void on_damage(void *arg, uint32_t node_index, int error, const struct why *why)
{
	struct report *report = arg;

	(void)error;
	report->newest = *why;
	if (report->json)
		print_json_damage(report, node_index, why);
	else
		print_damage(report, node_index, why);
	report->damage_count++;
}

static void skip_damaged_records(void *arg, uint32_t first, uint32_t count)
{
	(void)arg;
	(void)first;
	(void)count;
}

/*
 * What can be read of a store that may be damaged.  The pass names only nodes whose records it has
 * found whole, and it found them in the same bytes.
 */
static void open_for_names(const char *path, struct ctl_store *store)
{
	if (store_open_path(path, &store->file, NULL) < 0)
		return;
	store->superblock = store_superblock(store->file);
	store->nodes = calloc(store->superblock->node_count, sizeof(*store->nodes));
	if (store->nodes)
		(void)store_hs_read(store_fd(store->file), store->superblock, store->nodes,
				    skip_damaged_records, NULL, NULL);
	(void)store_load_names(store->file, &store->names, NULL);
}

static int verify(struct report *report)
{
	struct store_verify_summary summary = { 0 };
	char size[TEXT_SIZE_BYTES];
	struct why why;
	int r;

	if (report->json) {
		fputs("{\n  \"store\": ", stdout);
		text_write_json(stdout, report->path);
		fputs(",\n  \"damage\": [", stdout);
	}
	r = store_verify_path(report->path, on_damage, report, &summary, &why);
	if (report->json)
		printf("],\n  \"whole\": %s,\n  \"nodes_read\": %" PRIu64
		       ",\n  \"nodes_damaged\": %" PRIu64 ",\n  \"bytes_read\": %" PRIu64 "\n}\n",
		       r == 0 ? "true" : "false", summary.nodes_read, summary.nodes_damaged,
		       summary.bytes_read);
	if (r == 0) {
		if (!report->json)
			printf("%s: whole: %" PRIu64 " payloads, %s\n", report->path,
			       summary.nodes_read, text_from_size(summary.bytes_read, size));
		return CTL_OK;
	}
	if (r == -EBADMSG && summary.nodes_read == 0)
		log_error("%s: %s; build it again, or restore a copy", report->path,
			  report->newest.text);
	else if (r == -EBADMSG)
		log_error("%s: damaged: %" PRIu64 " of %" PRIu64 " payloads, %" PRIu64
			  " faults; build it again, or restore a copy",
			  report->path, summary.nodes_damaged, summary.nodes_read,
			  report->damage_count);
	else
		log_error("%s", why.text);
	return CTL_FAILED;
}

int ctl_verify(int argc, char **argv)
{
	struct report report = { 0 };
	int status;

	status = ctl_parse_json(argc, argv, help, &report.json);
	if (status != CTL_OK)
		return status < 0 ? CTL_OK : status;
	if (argc - optind != 1)
		return ctl_usage("verify", "wants one store");
	report.path = argv[optind];
	open_for_names(report.path, &report.store);
	status = verify(&report);
	ctl_store_close(&report.store);
	return status;
}
