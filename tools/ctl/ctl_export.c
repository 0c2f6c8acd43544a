/* SPDX-License-Identifier: MIT */
#include <errno.h>
#include <fcntl.h>
#include <getopt.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "formats/base/bytes.h"
#include "formats/base/file.h"
#include "formats/base/log.h"
#include "formats/base/text.h"
#include "formats/store/new_file.h"
#include "formats/store/payload.h"
#include "tools/ctl/ctl.h"
#include "tools/ctl/export_ply.h"

#define OUTPUT_BUFFER_BYTES MIB

/** What was asked for. */
struct request {
	const char *store_path;
	const char *output_path; /* "-": standard output */
	const char *part_pattern;
	bool has_box;
	double box[6]; /* least corner, then greatest; model units */
	bool ascii;
	bool normals;
	bool colours;
};

/**
 * The store is gone through three times, one node at a time, so that memory stays bounded: to count
 * and to see whether floats hold the positions, for the vertices, and for the triangles.
 */
struct exporter {
	const struct request *request;
	struct ctl_store store;
	struct ctl_payload payload;
	struct export_ply ply;
	bool *part_is_wanted; /* NULL: all are */

	/* Of the node at hand: */
	const struct store_node *node;
	struct payload_view view;
	uint32_t *vertex_at; /* number of a vertex among those kept, or VERTEX_DROPPED */
	uint32_t vertices_kept;
	uint32_t triangles_kept;
	uint64_t vertex_first; /* number of its first kept vertex in the file */
};

#define VERTEX_DROPPED UINT32_MAX
#define TRIANGLE_NONE  UINT32_MAX

static const char help_text[] =
	"Usage: oocctl export STORE -o FILE.ply [OPTION]...\n"
	"Writes the triangles of a store's leaves as PLY, in bounded memory.  Positions are written\n"
	"as floats where these hold them exactly, else as doubles: a store that was built with\n"
	"--error 0 gives back its input, as a set of triangles.\n"
	"\n"
	"  -o, --output FILE      where to; - is standard output\n"
	"      --box X0,Y0,Z0,X1,Y1,Z1\n"
	"                         only triangles whose own box touches this one; model units\n"
	"      --part PATTERN     only parts whose name, scene path or section matches\n"
	"      --normals          write normals, too\n"
	"      --colours          write colours, too: the vertices', else the parts'\n"
	"      --ascii            text, not binary\n"
	"      --help             this text\n"
	"\n"
	"Examples:\n"
	"  oocctl export plant.ooc -o plant.ply\n"
	"  oocctl export plant.ooc --part '*pump*' --colours -o - | gzip > pumps.ply.gz";

/* ---- which triangles ---- */

/* From the world's origin.  One of 0 is not added: -0 stays -0. */
static void vertex_position(const struct exporter *exporter, uint32_t vertex, double ret[3])
{
	const double *origin = exporter->store.superblock->origin;

	payload_position(&exporter->view, vertex, ret);
	for (unsigned axis = 0; axis < 3; axis++)
		if (origin[axis] != 0)
			ret[axis] += origin[axis];
}

static bool box_is_touched(const struct request *request, const double least[3],
			   const double greatest[3])
{
	for (unsigned axis = 0; axis < 3; axis++)
		if (greatest[axis] < request->box[axis] || least[axis] > request->box[axis + 3])
			return false;
	return true;
}

static bool node_is_wanted(const struct exporter *exporter, const struct store_node *node)
{
	double least[3];
	double greatest[3];

	if (node->child_count > 0 || node->payload_id == 0)
		return false;
	if (!exporter->request->has_box)
		return true;
	for (unsigned axis = 0; axis < 3; axis++) {
		double origin = exporter->store.superblock->origin[axis];

		least[axis] = origin + (double)node->box_min[axis];
		greatest[axis] = origin + (double)node->box_max[axis];
	}
	return box_is_touched(exporter->request, least, greatest);
}

/* Is a point in the node's cell?  Cells own their lower faces; what is outside goes to the nearest. */
static bool cell_holds(const struct exporter *exporter, const double point[3])
{
	const struct store_superblock *superblock = exporter->store.superblock;
	const struct store_node *node = exporter->node;
	double size = ldexp(superblock->root_size, -(int)node->level);

	for (unsigned axis = 0; axis < 3; axis++) {
		double from_root = point[axis] - superblock->root_min[axis];
		double cell = fmin(fmax(floor(from_root / size), 0), ldexp(1, node->level) - 1);

		if (cell != (double)node->cell[axis])
			return false;
	}
	return true;
}

/*
 * A replicated triangle is in every leaf that it touches; it is taken from the one whose cell holds
 * its least corner, which is the same corner in all of them.
 */
static bool is_first_copy(const struct exporter *exporter, uint32_t triangle)
{
	const struct payload_view *view = &exporter->view;
	double least[3];

	payload_position(view, payload_index(view, triangle, 0), least);
	for (uint32_t corner = 1; corner < 3; corner++) {
		double position[3];
		unsigned axis = 0;

		payload_position(view, payload_index(view, triangle, corner), position);
		while (axis < 2 && position[axis] == least[axis])
			axis++;
		if (position[axis] < least[axis])
			memcpy(least, position, sizeof(least));
	}
	return cell_holds(exporter, least);
}

static bool triangle_touches_box(const struct exporter *exporter, uint32_t triangle)
{
	double least[3] = { INFINITY, INFINITY, INFINITY };
	double greatest[3] = { -INFINITY, -INFINITY, -INFINITY };

	for (uint32_t corner = 0; corner < 3; corner++) {
		double position[3];

		vertex_position(exporter, payload_index(&exporter->view, triangle, corner),
				position);
		for (unsigned axis = 0; axis < 3; axis++) {
			least[axis] = fmin(least[axis], position[axis]);
			greatest[axis] = fmax(greatest[axis], position[axis]);
		}
	}
	return box_is_touched(exporter->request, least, greatest);
}

/** A walk over the wanted triangles of the node at hand. */
struct triangle_walk {
	uint32_t triangle; /* the next to look at */
	uint32_t run;
};

static uint32_t next_triangle(const struct exporter *exporter, struct triangle_walk *walk)
{
	const struct payload_header *header = exporter->view.header;
	const struct payload_run *runs = exporter->view.runs;
	bool is_replicated = exporter->store.superblock->layout == STORE_LAYOUT_REPLICATE;

	while (walk->triangle < header->triangle_count) {
		uint32_t triangle = walk->triangle++;

		while (walk->run + 1 < header->run_count &&
		       runs[walk->run + 1].first_triangle <= triangle)
			walk->run++;
		if (exporter->part_is_wanted && !exporter->part_is_wanted[runs[walk->run].part])
			continue;
		if (is_replicated && !is_first_copy(exporter, triangle))
			continue;
		if (exporter->request->has_box && !triangle_touches_box(exporter, triangle))
			continue;
		return triangle;
	}
	return TRIANGLE_NONE;
}

/* Numbers the vertices of the wanted triangles in the order of the payload, and counts both. */
static void keep_vertices(struct exporter *exporter)
{
	const struct payload_view *view = &exporter->view;
	uint32_t *vertex_at = exporter->vertex_at;
	struct triangle_walk walk = { 0 };
	uint32_t triangle;

	exporter->triangles_kept = 0;
	exporter->vertices_kept = 0;
	for (uint32_t i = 0; i < view->header->vertex_count; i++)
		vertex_at[i] = VERTEX_DROPPED;
	while ((triangle = next_triangle(exporter, &walk)) != TRIANGLE_NONE) {
		for (uint32_t corner = 0; corner < 3; corner++)
			vertex_at[payload_index(view, triangle, corner)] = 0;
		exporter->triangles_kept++;
	}
	for (uint32_t i = 0; i < view->header->vertex_count; i++)
		if (vertex_at[i] != VERTEX_DROPPED)
			vertex_at[i] = exporter->vertices_kept++;
}

/* ---- what the three passes do with a node ---- */

typedef int (*node_fn)(struct exporter *exporter);

static int count_node(struct exporter *exporter)
{
	const struct payload_view *view = &exporter->view;
	struct export_ply *ply = &exporter->ply;

	if (ply->normals && !view->normals) {
		log_error("%s: has no normals: leave --normals out", exporter->request->store_path);
		return -EINVAL;
	}
	ply->vertex_count += exporter->vertices_kept;
	ply->triangle_count += exporter->triangles_kept;
	for (uint32_t i = 0; i < view->header->vertex_count && !ply->positions_double; i++) {
		double position[3];

		if (exporter->vertex_at[i] == VERTEX_DROPPED)
			continue;
		vertex_position(exporter, i, position);
		for (unsigned axis = 0; axis < 3; axis++)
			if ((double)(float)position[axis] != position[axis])
				ply->positions_double = true;
	}
	return 0;
}

static void colour_of(const struct payload_view *view, uint32_t vertex, uint8_t ret[4])
{
	if (view->colours)
		memcpy(ret, view->colours + (size_t)vertex * 4, 4);
	else
		memcpy(ret, &view->runs[payload_vertex_run(view, vertex)].colour, 4);
}

static void normal_of(const struct payload_view *view, uint32_t vertex, float ret[3])
{
	if (view->normal_format == PAYLOAD_OCT8)
		payload_decode_oct8((const int8_t *)view->normals + (size_t)vertex * 2, ret);
	else
		payload_decode_oct16((const int16_t *)view->normals + (size_t)vertex * 2, ret);
}

static int write_vertices(struct exporter *exporter)
{
	const struct payload_view *view = &exporter->view;
	struct export_vertex vertex;

	for (uint32_t i = 0; i < view->header->vertex_count; i++) {
		if (exporter->vertex_at[i] == VERTEX_DROPPED)
			continue;
		vertex_position(exporter, i, vertex.position);
		if (exporter->ply.normals)
			normal_of(view, i, vertex.normal);
		if (exporter->ply.colours)
			colour_of(view, i, vertex.colour);
		export_ply_vertex(&exporter->ply, &vertex);
	}
	return 0;
}

static int write_triangles(struct exporter *exporter)
{
	struct triangle_walk walk = { 0 };
	uint32_t triangle;

	while ((triangle = next_triangle(exporter, &walk)) != TRIANGLE_NONE) {
		uint32_t corners[3];

		for (uint32_t i = 0; i < 3; i++) {
			uint32_t vertex = payload_index(&exporter->view, triangle, i);

			corners[i] = (uint32_t)exporter->vertex_first + exporter->vertex_at[vertex];
		}
		export_ply_triangle(&exporter->ply, corners);
	}
	return 0;
}

/* ---- a pass ---- */

static int load_node(struct exporter *exporter, uint32_t node_index)
{
	const struct store_superblock *superblock = exporter->store.superblock;
	const struct request *request = exporter->request;
	struct why why;
	int r;

	exporter->node = &exporter->store.nodes[node_index];
	r = store_read_payload(exporter->store.file, exporter->node, exporter->payload.decoded,
			       exporter->payload.stored, &why);
	if (r < 0) {
		log_error("%s: node %u: %s: `oocctl verify` names all that is damaged",
			  request->store_path, node_index, why.text);
		return r;
	}
	payload_view(exporter->payload.decoded, &exporter->view);
	for (uint32_t i = 0; i < exporter->view.header->run_count; i++)
		if (exporter->view.runs[i].part >= superblock->part_count) {
			log_error("%s: node %u: a run is of part %u of %" PRIu64,
				  request->store_path, node_index, exporter->view.runs[i].part,
				  superblock->part_count);
			return -EUCLEAN;
		}
	return 0;
}

/* A line that is written over itself, for a person who waits. */
static void show_progress(const struct exporter *exporter, unsigned pass, uint64_t node_index)
{
	uint64_t node_count = exporter->store.superblock->node_count;

	if (isatty(STDERR_FILENO) && (node_index % 64 == 0 || node_index == node_count))
		fprintf(stderr, "\roocctl: export: %3" PRIu64 " %%%s",
			(pass * node_count + node_index) * 100 / (3 * node_count),
			pass == 2 && node_index == node_count ? "\n" : "");
}

static int for_each_node(struct exporter *exporter, unsigned pass, node_fn take)
{
	uint64_t node_count = exporter->store.superblock->node_count;

	exporter->vertex_first = 0;
	for (uint32_t i = 0; i < node_count; i++) {
		int r;

		show_progress(exporter, pass, i);
		if (!node_is_wanted(exporter, &exporter->store.nodes[i]))
			continue;
		r = load_node(exporter, i);
		if (r < 0)
			return r;
		keep_vertices(exporter);
		r = take(exporter);
		if (r < 0)
			return r;
		exporter->vertex_first += exporter->vertices_kept;
		if (exporter->ply.out && ferror(exporter->ply.out))
			break;
	}
	show_progress(exporter, pass, node_count);
	return 0;
}

static int write_all(struct exporter *exporter)
{
	int r;

	export_ply_header(&exporter->ply);
	r = for_each_node(exporter, 1, write_vertices);
	if (r == 0)
		r = for_each_node(exporter, 2, write_triangles);
	if (r == 0 && (fflush(exporter->ply.out) != 0 || ferror(exporter->ply.out))) {
		log_error("%s: cannot be written: %s", exporter->request->output_path,
			  strerror(errno));
		r = -EIO;
	}
	return r;
}

/* To standard output there is no whole or nothing: the exit status says which it was. */
static int write_to_stdout(struct exporter *exporter)
{
	exporter->ply.out = stdout;
	(void)setvbuf(stdout, NULL, _IOFBF, OUTPUT_BUFFER_BYTES);
	return write_all(exporter);
}

static int write_to_file(struct exporter *exporter)
{
	const char *path = exporter->request->output_path;
	struct new_file *file;
	struct why why;
	int fd;
	int r;

	r = new_file_create(path, &file, &why);
	if (r < 0) {
		log_error("%s", why.text);
		return r;
	}
	fd = fcntl(new_file_fd(file), F_DUPFD_CLOEXEC, 0);
	exporter->ply.out = fd >= 0 ? fdopen(fd, "w") : NULL;
	if (!exporter->ply.out) {
		r = -errno;
		fd = fd_close(fd);
		log_error("%s: %s", path, strerror(-r));
	} else {
		(void)setvbuf(exporter->ply.out, NULL, _IOFBF, OUTPUT_BUFFER_BYTES);
		r = write_all(exporter);
		(void)fclose(exporter->ply.out);
	}
	if (r == 0 && fsync(new_file_fd(file)) < 0) {
		r = -errno;
		log_error("%s: cannot be flushed: %s", path, strerror(-r));
	}
	if (r == 0) {
		r = new_file_commit(file, &why);
		if (r < 0)
			log_error("%s", why.text);
	}
	new_file_destroy(file);
	return r;
}

/* ---- the whole ---- */

static int find_parts(struct exporter *exporter)
{
	const struct request *request = exporter->request;
	uint64_t part_count = exporter->store.superblock->part_count;
	uint64_t found = 0;

	if (!request->part_pattern)
		return 0;
	exporter->part_is_wanted = calloc(part_count + 1, sizeof(bool));
	if (!exporter->part_is_wanted) {
		log_error("no memory");
		return -ENOMEM;
	}
	for (uint64_t i = 0; i < part_count; i++) {
		exporter->part_is_wanted[i] =
			ctl_part_matches(&exporter->store.names, i, request->part_pattern);
		found += exporter->part_is_wanted[i];
	}
	if (found > 0)
		return 0;
	log_error("%s: no part matches '%s': `oocctl parts` lists them", request->store_path,
		  request->part_pattern);
	return -ENOENT;
}

static uint32_t most_vertices(const struct ctl_store *store)
{
	uint32_t most = 0;

	for (uint64_t i = 0; i < store->superblock->node_count; i++)
		if (store->nodes[i].vertex_count > most)
			most = store->nodes[i].vertex_count;
	return most;
}

static int export_store(struct exporter *exporter)
{
	const struct request *request = exporter->request;
	bool to_stdout = strcmp(request->output_path, "-") == 0;
	int r;

	r = find_parts(exporter);
	if (r == 0)
		r = ctl_payload_init(&exporter->payload, &exporter->store);
	if (r < 0)
		return r;
	/* At most a payload's limit over its shortest position: the HS was judged. */
	exporter->vertex_at =
		calloc((size_t)most_vertices(&exporter->store) + 1, sizeof(*exporter->vertex_at));
	if (!exporter->vertex_at) {
		log_error("no memory");
		return -ENOMEM;
	}
	r = for_each_node(exporter, 0, count_node);
	if (r < 0)
		return r;
	if (exporter->ply.vertex_count > UINT32_MAX) {
		log_error("%s: %" PRIu64
			  " vertices are more than PLY can number: export it in pieces with --box",
			  request->store_path, exporter->ply.vertex_count);
		return -EOVERFLOW;
	}
	return to_stdout ? write_to_stdout(exporter) : write_to_file(exporter);
}

/* "x0,y0,z0,x1,y1,z1" */
static int parse_box(const char *text, double ret[6])
{
	char number[64];

	for (unsigned i = 0; i < 6; i++) {
		size_t length = strcspn(text, ",");

		if (length >= sizeof(number) || (text[length] == ',') != (i < 5))
			return -EINVAL;
		memcpy(number, text, length);
		number[length] = '\0';
		if (text_to_double(number, &ret[i]) < 0)
			return -EINVAL;
		text += length + 1;
	}
	for (unsigned axis = 0; axis < 3; axis++)
		if (ret[axis] > ret[axis + 3])
			return -EINVAL;
	return 0;
}

/* Returns: CTL_OK to go on, or -1 after --help, or CTL_USAGE. */
static int parse(int argc, char **argv, struct request *request)
{
	static const struct option options[] = {
		{ "output", required_argument, NULL, 'o' }, { "box", required_argument, NULL, 'b' },
		{ "part", required_argument, NULL, 'p' },   { "normals", no_argument, NULL, 'n' },
		{ "colours", no_argument, NULL, 'c' },      { "ascii", no_argument, NULL, 'a' },
		{ "help", no_argument, NULL, 'h' },         { 0 },
	};
	int option;

	while ((option = getopt_long(argc, argv, "o:h", options, NULL)) != -1) {
		switch (option) {
		case 'o':
			request->output_path = optarg;
			break;
		case 'b':
			request->has_box = true;
			if (parse_box(optarg, request->box) < 0)
				return ctl_usage("export", "--box wants X0,Y0,Z0,X1,Y1,Z1");
			break;
		case 'p':
			request->part_pattern = optarg;
			break;
		case 'n':
			request->normals = true;
			break;
		case 'c':
			request->colours = true;
			break;
		case 'a':
			request->ascii = true;
			break;
		case 'h':
			puts(help_text);
			return -1;
		default:
			return CTL_USAGE;
		}
	}
	if (argc - optind != 1)
		return ctl_usage("export", "wants one store");
	if (!request->output_path)
		return ctl_usage("export", "wants -o FILE");
	request->store_path = argv[optind];
	return CTL_OK;
}

int ctl_export(int argc, char **argv)
{
	struct request request = { 0 };
	struct exporter exporter = { .request = &request };
	int status = parse(argc, argv, &request);

	if (status != CTL_OK)
		return status < 0 ? CTL_OK : status;
	status = ctl_store_open(request.store_path, &exporter.store);
	if (status != CTL_OK)
		return status;
	exporter.ply.ascii = request.ascii;
	exporter.ply.normals = request.normals;
	exporter.ply.colours = request.colours;
	status = export_store(&exporter) < 0 ? CTL_FAILED : CTL_OK;
	free(exporter.vertex_at);
	free(exporter.part_is_wanted);
	ctl_payload_done(&exporter.payload);
	ctl_store_close(&exporter.store);
	return status;
}
