/* SPDX-License-Identifier: MIT */
/*
 * ooc_list - what lies in a box of a store, part by part.
 *
 *	ooc_list STORE.ooc [MIN_X MIN_Y MIN_Z MAX_X MAX_Y MAX_Z]
 *
 *	cc ooc_list.c $(pkg-config --cflags --libs oocclient) -o ooc_list
 *
 * A first program with the library.  It does once what a viewer does each frame:
 *
 *	1. connect: NULL means "the daemon that is there, or a new one of my own";
 *	2. open a store.  Its hierarchy (HS) is in memory from then on: one record a node, with a box,
 *	   so that we can choose nodes without touching geometry;
 *	3. say which nodes we want, most important first;
 *	4. wait until the set is settled.  A viewer would not wait but draw what is there;
 *	5. read the payloads where they lie, in memory that all programs share.
 *
 * Boxes are in the store's own coordinates: model units from ooc_superblock()->origin.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <ooc/client.h>

struct box {
	double min[3];
	double max[3];
};

/* What was found of one part.  A part is what can be picked: one material of one object. */
struct part {
	unsigned long long triangle_count;
	struct box box;
};

static int node_meets_box(const struct store_node *node, const struct box *box)
{
	for (int i = 0; i < 3; i++) {
		if (node->box_max[i] < box->min[i] || node->box_min[i] > box->max[i])
			return 0;
	}
	return 1;
}

static const struct payload_stream *stream_find(const struct payload_header *header, int semantic)
{
	for (int i = 0; i < header->stream_count; i++) {
		if (header->streams[i].semantic == semantic)
			return &header->streams[i];
	}
	return NULL;
}

/* The corner's vertex: indices are 16 bits wide where all fit. */
static uint32_t index_read(const struct payload_header *header, const struct payload_stream *stream,
			   uint32_t corner)
{
	const uint8_t *bytes = (const uint8_t *)header + stream->offset_bytes;
	uint16_t narrow;
	uint32_t wide;

	if (stream->format == PAYLOAD_U16) {
		memcpy(&narrow, bytes + 2 * (size_t)corner, sizeof(narrow));
		return narrow;
	}
	memcpy(&wide, bytes + 4 * (size_t)corner, sizeof(wide));
	return wide;
}

/* Positions are small integers (or floats) times a power of two: exact in double. */
static void position_read(const struct payload_header *header, const struct payload_stream *stream,
			  uint32_t vertex, double ret[3])
{
	const uint8_t *bytes = (const uint8_t *)header + stream->offset_bytes +
			       (size_t)vertex * stream->element_bytes;

	for (int i = 0; i < 3; i++) {
		uint16_t narrow;
		float wide;

		if (stream->format == PAYLOAD_U16X3_RUN) {
			memcpy(&narrow, bytes + 2 * i, sizeof(narrow));
			ret[i] = header->origin[i] + header->scale * narrow;
		} else {
			memcpy(&wide, bytes + 4 * i, sizeof(wide));
			ret[i] = header->origin[i] + header->scale * (double)wide;
		}
	}
}

static void part_add(struct part *part, const double position[3])
{
	for (int i = 0; i < 3; i++) {
		if (position[i] < part->box.min[i])
			part->box.min[i] = position[i];
		if (position[i] > part->box.max[i])
			part->box.max[i] = position[i];
	}
}

/*
 * Counts a payload's triangles into its parts.  A payload is a header, runs of triangles that belong
 * to one part each, and streams.  The daemon has judged all of it, so nothing is checked here.
 */
static void payload_add(const struct payload_header *header, struct part *parts)
{
	const struct payload_run *runs =
		(const void *)((const uint8_t *)header + header->runs_offset_bytes);
	const struct payload_stream *indices = stream_find(header, PAYLOAD_INDEX);
	const struct payload_stream *positions = stream_find(header, PAYLOAD_POSITION);

	for (uint32_t i = 0; i < header->run_count; i++) {
		struct part *part = &parts[runs[i].part];
		uint32_t end = i + 1 < header->run_count ? runs[i + 1].first_triangle
							 : header->triangle_count;

		for (uint32_t corner = 3 * runs[i].first_triangle; corner < 3 * end; corner++) {
			double position[3];

			position_read(header, positions, index_read(header, indices, corner),
				      position);
			part_add(part, position);
		}
		part->triangle_count += end - runs[i].first_triangle;
	}
}

/* Wants all leaves that meet the box; nearer to its middle would be more important in a viewer. */
static size_t wants_make(struct ooc_store *store, const struct box *box, struct ooc_want *wants)
{
	const struct store_node *nodes = ooc_nodes(store);
	size_t count = 0;

	for (uint32_t i = 0; i < ooc_node_count(store); i++) {
		if (nodes[i].child_count == 0 && nodes[i].payload_bytes > 0 &&
		    node_meets_box(&nodes[i], box)) {
			wants[count].store = store;
			wants[count].node = i;
			wants[count].importance = 1.0f;
			count++;
		}
	}
	return count;
}

/*
 * One set may be larger than the cache.  What does not fit is answered "not now", and then the set is
 * looked at in portions: whatever is drawable now is counted, and the rest is wanted next.
 */
static int nodes_list(struct ooc_client *client, struct ooc_want *wants, size_t count,
		      struct part *parts)
{
	while (count > 0) {
		size_t left = 0;
		int r;

		if (ooc_visible_set(client, wants, count) < 0)
			return -1;
		r = ooc_wait(client, 60000);
		if (r < 0)
			return -1;
		for (size_t i = 0; i < count; i++) {
			const void *payload = ooc_map(wants[i].store, wants[i].node);

			if (payload)
				payload_add(payload, parts);
			else if (ooc_not_now(wants[i].store, wants[i].node) == OOC_REASON_FULL)
				wants[left++] = wants[i];
			else
				fprintf(stderr, "ooc_list: node %u cannot be read\n",
					(unsigned)wants[i].node);
		}
		if (left == count)
			return -1;
		count = left;
	}
	return 0;
}

static void parts_print(const struct part *parts, uint64_t part_count)
{
	for (uint64_t i = 0; i < part_count; i++) {
		const struct box *box = &parts[i].box;

		if (parts[i].triangle_count > 0)
			printf("part %llu: %llu triangles, %g %g %g to %g %g %g\n",
			       (unsigned long long)i, parts[i].triangle_count, box->min[0],
			       box->min[1], box->min[2], box->max[0], box->max[1], box->max[2]);
	}
}

static int store_list(struct ooc_client *client, struct ooc_store *store, const struct box *given)
{
	const struct store_superblock *superblock = ooc_superblock(store);
	struct part *parts = calloc(superblock->part_count + 1, sizeof(*parts));
	struct ooc_want *wants = calloc(ooc_node_count(store), sizeof(*wants));
	struct box box;
	int r = -1;

	memcpy(box.min, superblock->box_min, sizeof(box.min));
	memcpy(box.max, superblock->box_max, sizeof(box.max));
	if (given)
		box = *given;
	if (parts && wants) {
		for (uint64_t i = 0; i < superblock->part_count; i++) {
			for (int k = 0; k < 3; k++) {
				parts[i].box.min[k] = superblock->box_max[k];
				parts[i].box.max[k] = superblock->box_min[k];
			}
		}
		r = nodes_list(client, wants, wants_make(store, &box, wants), parts);
		if (r == 0)
			parts_print(parts, superblock->part_count);
	}
	free(wants);
	free(parts);
	return r;
}

int main(int argc, char **argv)
{
	struct ooc_client *client;
	struct ooc_store *store;
	struct box box;
	int r = -1;

	if (argc != 2 && argc != 8) {
		fprintf(stderr, "Usage: ooc_list STORE.ooc "
				"[MIN_X MIN_Y MIN_Z MAX_X MAX_Y MAX_Z]\n");
		return 2;
	}
	for (int i = 0; argc == 8 && i < 3; i++) {
		box.min[i] = strtod(argv[2 + i], NULL);
		box.max[i] = strtod(argv[5 + i], NULL);
	}
	if (ooc_connect(NULL, "ooc_list", &client) < 0) {
		fprintf(stderr, "ooc_list: %s\n", ooc_error_text(NULL));
		return 1;
	}
	if (ooc_open(client, argv[1], &store) == 0)
		r = store_list(client, store, argc == 8 ? &box : NULL);
	if (r < 0)
		fprintf(stderr, "ooc_list: %s: %s\n", argv[1], ooc_error_text(client));
	/* Closes the store as well. */
	ooc_disconnect(client);
	return r < 0 ? 1 : 0;
}
