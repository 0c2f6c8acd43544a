/* SPDX-License-Identifier: MIT */
#include "tools/build/build.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "formats/base/clock.h"
#include "formats/base/file.h"
#include "formats/store/store_writer.h"
#include "tools/build/borders.h"
#include "tools/build/cut.h"
#include "tools/build/deal.h"
#include "tools/build/hierarchy.h"
#include "tools/build/soup.h"

/** Program, libraries, stacks and what malloc keeps: not in any table. */
#define BASE_BYTES (24 * MIB)
/** What an importer needs at least. */
#define IMPORTER_BYTES_MIN (16 * MIB)

/** Everything of one build. */
struct build {
	const struct build_options *options;
	struct crew *crew;
	struct build_report *report;
	struct progress progress;
	struct budget budget;
	const char *scratch_directory;
	char *output_directory;
	uint32_t bucket_triangles;
	uint64_t worker_bytes; /* kept for workers in all phases after the import */

	struct import_inputs inputs;
	struct spool_pool *pool;
	struct spool *soup_spool;
	struct spool *deal_spool;
	struct soup soup;
	bool soup_made;
	struct labels labels;
	struct grid grid;
	struct record_shape shape;
	struct buckets buckets;
	struct exchange *triangles;
	struct exchange *records;
	struct exchange *answers;
	struct borders borders;
	struct store_writer *writer;
	struct cut cut;
	struct hierarchy hierarchy;
	double moved_max;
};

/* ---- memory ---- */

static uint32_t workers_within(const struct build *build, uint64_t bytes_each)
{
	uint64_t count = build->worker_bytes / bytes_each;

	return (uint32_t)u64_max(u64_min(count, build->crew->worker_count), 1);
}

/* Where triangles are replicated, a cell that cannot be cut is a leaf as it is. */
static uint32_t leaf_max(const struct build *build)
{
	return build->options->layout == STORE_LAYOUT_REPLICATE ? build->bucket_triangles
								: build->options->leaf_triangles;
}

/* What the hungriest phase takes for all workers, within half of what there is. */
static int plan_memory(struct build *build, struct why *why)
{
	const struct build_options *options = build->options;
	/* The widest record: how wide it will be is known only after the import. */
	const struct record_shape widest = { .position_words = 6, .words = RECORD_WORDS_MAX };
	uint64_t each =
		cut_worker_bytes(&widest, build->bucket_triangles, leaf_max(build), options->codec);
	uint64_t room;

	each = u64_max(each, deal_worker_bytes(&widest));
	if (options->memory_bytes < BUILD_MEMORY_MIN ||
	    options->memory_bytes < BASE_BYTES + each + 2 * SPOOL_SEGMENT_BYTES)
		return why_set(
			why, -ENOMEM, "--memory %lluM is too little: at least %lluM are needed",
			(unsigned long long)(options->memory_bytes / MIB),
			(unsigned long long)(u64_max(BUILD_MEMORY_MIN,
						     BASE_BYTES + each + 2 * SPOOL_SEGMENT_BYTES) /
					     MIB));
	room = options->memory_bytes - BASE_BYTES;
	build->worker_bytes = u64_max(u64_min(each * options->jobs, room / 2), each);
	budget_init(&build->budget, room - build->worker_bytes);
	return 0;
}

/* ---- import ---- */

static int open_spools(struct build *build, struct why *why)
{
	int r = spool_pool_create(&build->budget, &build->pool);

	if (r == 0)
		r = spool_create(build->pool, build->scratch_directory, &build->soup_spool);
	if (r == 0)
		r = spool_create(build->pool, build->scratch_directory, &build->deal_spool);
	if (r == 0)
		r = soup_init(&build->soup, build->soup_spool, &build->budget, &build->inputs);
	build->soup_made = r == 0;
	return r == 0 ? 0 : why_set(why, r, "no memory to begin");
}

/* Units and axis: what the user says, else the first file that does. */
static void settle_units(struct build *build)
{
	struct build_report *report = build->report;

	report->unit_metres = build->options->unit_metres;
	report->up_axis = build->options->up_axis;
	for (size_t i = 0; i < build->inputs.input_count; i++) {
		const struct soup_section *section = &build->soup.sections[i];

		if (build->options->unit_metres == 0 && section->unit_metres > 0) {
			if (report->unit_metres == 0)
				report->unit_metres = section->unit_metres;
			report->units_differ |= report->unit_metres != section->unit_metres;
		}
		if (build->options->up_axis == STORE_AXIS_UNKNOWN &&
		    section->up_axis != STORE_AXIS_UNKNOWN) {
			if (report->up_axis == STORE_AXIS_UNKNOWN)
				report->up_axis = section->up_axis;
			report->units_differ |= report->up_axis != section->up_axis;
		}
	}
}

static int import_all(struct build *build, struct why *why)
{
	const struct build_options *options = build->options;
	struct soup_options soup_options = {
		.colour = options->colour,
		.drop_non_finite = options->drop_non_finite,
		.scratch_directory = build->scratch_directory,
	};
	uint64_t share;
	uint64_t jobs;
	struct part_list *lists;
	int r;

	r = import_inputs_expand(options->inputs, options->input_count, &build->inputs, why);
	if (r == 0)
		r = open_spools(build, why);
	if (r < 0)
		return r;
	/* While files are read, the workers of later phases need nothing yet. */
	jobs = u64_max(u64_min(options->jobs, build->inputs.input_count), 1);
	share = build->worker_bytes + budget_left(&build->budget) / 2;
	while (jobs > 1 && share / jobs < IMPORTER_BYTES_MIN + 2 * SOUP_BLOCK_BYTES_MAX)
		jobs--;
	soup_options.memory_bytes = share / jobs - 2 * SOUP_BLOCK_BYTES_MAX;
	budget_charge(&build->budget, share - build->worker_bytes);
	build->crew->worker_count = (uint32_t)jobs;
	/* One large file keeps one processor busy; another can clear memory for it. */
	if (jobs < options->jobs)
		spool_pool_warm(build->pool);
	r = soup_import(&build->soup, build->crew, &soup_options, &build->progress, why);
	spool_pool_cool(build->pool);
	build->crew->worker_count = options->jobs;
	budget_give(&build->budget, share - build->worker_bytes);
	if (r < 0)
		return r;
	settle_units(build);
	lists = calloc(build->inputs.input_count + 1, sizeof(*lists));
	if (!lists)
		return why_set(why, -ENOMEM, "no memory for names");
	for (size_t i = 0; i < build->inputs.input_count; i++) {
		lists[i] = build->soup.sections[i].parts;
		build->soup.sections[i].parts = (struct part_list){ 0 };
	}
	r = labels_join(&build->labels, &build->inputs, lists, why);
	for (size_t i = 0; i < build->inputs.input_count; i++)
		part_list_done(&lists[i]);
	free(lists);
	budget_charge(&build->budget, labels_bytes(&build->labels));
	return r;
}

/* ---- the octree ---- */

static bool wants_normals(const struct build *build)
{
	enum normals_mode mode = build->options->normals;

	return (mode == NORMALS_OCT8 || mode == NORMALS_OCT16) &&
	       !(build->soup.normals && build->soup.all_normals);
}

static int choose_grid(struct build *build, struct why *why)
{
	const struct build_options *options = build->options;
	const struct soup *soup = &build->soup;
	int r = grid_choose(&build->grid, soup->box_min, soup->box_max, options->error,
			    soup->doubles, why);

	if (r < 0)
		return r;
	build->shape = record_shape(&build->grid, soup->normals && options->normals != NORMALS_FLAT,
				    soup->colours && options->colour <= IMPORT_COLOUR_VERTEX,
				    options->keep_ids);
	r = buckets_init(&build->buckets, &build->grid, options->layout, build->bucket_triangles);
	return r == 0 ? 0 : why_set(why, r, "no memory for the upper octree");
}

static int make_buckets(struct build *build, struct why *why)
{
	struct deal deal = {
		.soup = &build->soup,
		.grid = &build->grid,
		.shape = &build->shape,
		.labels = &build->labels,
		.buckets = &build->buckets,
		.crew = build->crew,
		.progress = &build->progress,
	};
	uint32_t workers = workers_within(build, deal_worker_bytes(&build->shape));
	int r;

	(void)pthread_mutex_init(&deal.lock, NULL);
	progress_phase(&build->progress, PHASE_COUNT, build->soup.triangle_count);
	r = deal_count(&deal, workers, why);
	budget_charge(&build->budget, buckets_table_bytes(&build->buckets));
	progress_phase(&build->progress, PHASE_DEAL, build->soup.triangle_count);
	if (r == 0)
		r = exchange_create(build->deal_spool, &build->budget, build->buckets.bucket_count,
				    &build->triangles);
	if (r == 0 && wants_normals(build) && build->buckets.bucket_count > 1) {
		r = exchange_create(build->deal_spool, &build->budget, build->buckets.bucket_count,
				    &build->records);
		if (r == 0)
			r = exchange_create(build->deal_spool, &build->budget,
					    build->buckets.bucket_count, &build->answers);
	}
	deal.triangles = build->triangles;
	deal.borders = build->records;
	if (r == 0)
		r = deal_out(&deal, workers, why);
	else
		(void)why_set(why, r, "no memory to deal triangles out");
	spool_pool_drain(build->pool);
	build->report->degenerate = deal.degenerate_count;
	build->moved_max = deal.moved_max;
	(void)pthread_mutex_destroy(&deal.lock);
	return r;
}

static uint64_t sum_of_triangles(const struct buckets *buckets)
{
	uint64_t sum = 0;

	for (uint32_t i = 0; i < buckets->bucket_count; i++)
		sum += buckets->buckets[i].triangle_count;
	return sum;
}

static int match_borders(struct build *build, struct why *why)
{
	build->borders = (struct borders){
		.grid = &build->grid,
		.shape = &build->shape,
		.buckets = &build->buckets,
		.labels = &build->labels,
		.triangles = build->triangles,
		.records = build->records,
		.answers = build->answers,
		.mode = build->options->normals,
		.threshold = normals_threshold(build->options->crease_degrees),
		.crew = build->crew,
		.progress = &build->progress,
	};
	if (!build->records)
		return 0;
	progress_phase(&build->progress, PHASE_BORDERS, sum_of_triangles(&build->buckets));
	return borders_answer(&build->borders,
			      workers_within(build, borders_worker_bytes(&build->borders)), why);
}

static int cut_all(struct build *build, struct why *why)
{
	const struct build_options *options = build->options;
	uint32_t workers;

	progress_phase(&build->progress, PHASE_CUT, sum_of_triangles(&build->buckets));
	build->cut = (struct cut){
		.borders = &build->borders,
		.labels = &build->labels,
		.writer = build->writer,
		.budget = &build->budget,
		.leaf_triangles = options->leaf_triangles,
		.leaf_vertices = options->leaf_vertices,
		.codec = options->codec,
		.crew = build->crew,
		.progress = &build->progress,
	};
	workers = workers_within(build, cut_worker_bytes(&build->shape, build->bucket_triangles,
							 leaf_max(build), options->codec));
	build->report->workers = workers;
	return cut_run(&build->cut, workers, why);
}

/* ---- finish ---- */

static void fill_superblock(struct build *build, struct store_superblock *superblock)
{
	const struct build_options *options = build->options;
	const struct hierarchy *hierarchy = &build->hierarchy;
	const struct grid *grid = &build->grid;
	struct build_report *report = build->report;
	double moved_max = build->moved_max;

	memset(superblock, 0, sizeof(*superblock));
	for (uint64_t i = 0; i < build->cut.leaf_count; i++) {
		const struct leaf *leaf = &build->cut.leaves[i];

		superblock->triangle_count += leaf->record.triangle_count;
		superblock->vertex_count += leaf->record.vertex_count;
		superblock->payload_stored_bytes += leaf->record.stored_bytes;
		superblock->payload_raw_bytes += leaf->record.payload_bytes;
		superblock->payload_bytes_max = (uint32_t)u64_max(superblock->payload_bytes_max,
								  leaf->record.payload_bytes);
		report->duplicates += leaf->duplicate_count;
		report->small_leaves += leaf->small;
		moved_max = fmax(moved_max, leaf->moved_max);
	}
	superblock->node_count = hierarchy->node_count;
	for (uint32_t i = 0; i < hierarchy->node_count; i++)
		superblock->leaf_count += hierarchy->nodes[i].child_count == 0;
	superblock->part_count = build->labels.part_count;
	superblock->section_count = build->labels.section_count;
	superblock->payload_id_next = build->cut.id_next;
	superblock->triangles_in = build->soup.triangle_count;
	superblock->level_max = hierarchy->level_max;
	for (unsigned k = 0; k < 3; k++) {
		superblock->origin[k] = grid->origin[k];
		superblock->root_min[k] = grid->root_min[k];
		superblock->box_min[k] = (double)hierarchy->nodes[0].box_min[k];
		superblock->box_max[k] = (double)hierarchy->nodes[0].box_max[k];
	}
	superblock->unit_metres = report->unit_metres;
	superblock->up_axis = (uint32_t)report->up_axis;
	superblock->error = grid->error;
	superblock->error_measured = moved_max;
	superblock->root_size = grid->root_size;
	superblock->crease_degrees = wants_normals(build) ? options->crease_degrees : -1;
	superblock->step_exponent = grid->step_exponent;
	superblock->layout = (uint32_t)options->layout;
	superblock->leaf_triangles_max = options->leaf_triangles;
	superblock->leaf_vertices_max =
		options->leaf_vertices == UINT32_MAX ? 0 : options->leaf_vertices;
	(void)snprintf((char *)superblock->producer, sizeof(superblock->producer), "oocbuild %s",
		       OOCD_VERSION);
}

static void fill_report(struct build *build, const struct store_superblock *superblock)
{
	struct build_report *report = build->report;
	uint64_t unique = 0;

	for (uint64_t i = 0; i < build->cut.leaf_count; i++)
		unique += build->cut.leaves[i].primary_count;
	/* Nothing got lost on the way. */
	CHECK(unique ==
	      build->soup.triangle_count - build->soup.non_finite_count - report->degenerate);
	report->triangles_in = build->soup.triangle_count;
	report->triangles_stored = superblock->triangle_count;
	report->non_finite = build->soup.non_finite_count;
	report->dropped_faces = build->soup.dropped_face_count;
	report->missing_textures = build->soup.missing_texture_count;
	report->replication_factor =
		unique > 0 ? (double)superblock->triangle_count / (double)unique : 1.0;
	report->sections = superblock->section_count;
	report->parts = superblock->part_count;
	report->nodes = superblock->node_count;
	report->leaves = build->cut.leaf_count;
	report->depth_limited_leaves = build->cut.limited_count;
	report->vertices = superblock->vertex_count;
	report->bytes = superblock->file_bytes;
	report->hs_bytes = superblock->hs.stored_bytes;
	report->names_bytes = superblock->names.stored_bytes;
	report->payload_bytes = superblock->payload_raw_bytes;
	report->largest_payload_bytes = superblock->payload_bytes_max;
	report->scratch_bytes = spool_scratch_bytes(build->soup_spool) +
				spool_scratch_bytes(build->deal_spool) + build->soup.scratch_bytes;
	report->generation = superblock->generation;
	report->buckets = build->buckets.bucket_count;
	report->step = build->grid.form == GRID_LATTICE ? build->grid.step : 0;
	report->error = build->grid.error;
	report->error_measured = superblock->error_measured;
	report->missing_material_file = build->soup.missing_material_file;
}

static int finish(struct build *build, struct why *why)
{
	struct store_names_content names;
	struct store_superblock superblock;
	int r;

	progress_phase(&build->progress, PHASE_FINISH, 0);
	r = hierarchy_make(&build->grid, build->cut.leaves, build->cut.leaf_count,
			   &build->hierarchy, why);
	if (r < 0)
		return r;
	fill_superblock(build, &superblock);
	names = labels_content(&build->labels);
	if (crew_stopped(build->crew))
		return why_set(why, -ECANCELED, "interrupted");
	r = store_writer_commit(build->writer, &superblock, build->hierarchy.nodes, &names, why);
	if (r == 0)
		fill_report(build, &superblock);
	return r;
}

/* ---- all of it ---- */

static int run_phases(struct build *build, struct why *why)
{
	/* First of all, so that who may not write there hears it at once. */
	int r = store_writer_create(build->options->output, &build->writer, why);

	if (r == 0)
		r = import_all(build, why);
	if (r == 0)
		r = choose_grid(build, why);
	if (r == 0)
		r = make_buckets(build, why);
	if (r == 0)
		r = match_borders(build, why);
	if (r == 0)
		r = cut_all(build, why);
	if (r == 0)
		r = finish(build, why);
	return r;
}

static void build_done(struct build *build)
{
	build->writer = store_writer_destroy(build->writer);
	hierarchy_done(&build->hierarchy);
	cut_done(&build->cut);
	build->triangles = exchange_destroy(build->triangles);
	build->records = exchange_destroy(build->records);
	build->answers = exchange_destroy(build->answers);
	buckets_done(&build->buckets);
	labels_done(&build->labels);
	if (build->soup_made)
		soup_done(&build->soup);
	build->soup_spool = spool_destroy(build->soup_spool);
	build->deal_spool = spool_destroy(build->deal_spool);
	build->pool = spool_pool_destroy(build->pool);
	import_inputs_done(&build->inputs);
	free(build->output_directory);
}

/* The folder of the output; scratch goes there unless the user says where. */
static int find_scratch(struct build *build, struct why *why)
{
	const char *slash = strrchr(build->options->output, '/');

	if (!slash)
		build->output_directory = strdup(".");
	else
		build->output_directory =
			strndup(build->options->output,
				(size_t)u64_max((uint64_t)(slash - build->options->output), 1));
	if (!build->output_directory)
		return why_set(why, -ENOMEM, "no memory to begin");
	build->scratch_directory = build->options->scratch_directory
					   ? build->options->scratch_directory
					   : build->output_directory;
	return 0;
}

/* What stands at the output's place is replaced, so it had better be a store. */
static int judge_output(const char *path, struct why *why)
{
	char magic[sizeof(STORE_MAGIC) - 1];
	struct stat status;
	AUTO_FD fd = -1;

	if (stat(path, &status) < 0)
		return errno == ENOENT ? 0 : why_errno(why, -errno, "%s", path);
	if (!S_ISREG(status.st_mode))
		return why_set(why, -EEXIST, "%s: is no file: a store cannot stand there", path);
	if (status.st_size == 0)
		return 0;
	fd = open(path, O_RDONLY | O_CLOEXEC);
	if (fd < 0)
		return why_errno(why, -errno, "%s", path);
	if (file_read_at(fd, magic, sizeof(magic), 0) < 0 ||
	    memcmp(magic, STORE_MAGIC, sizeof(magic)) != 0)
		return why_set(why, -EEXIST,
			       "%s: exists and is no store: remove it, or name another output",
			       path);
	return 0;
}

static uint64_t peak_bytes(void)
{
	struct rusage own;
	struct rusage children;

	if (getrusage(RUSAGE_SELF, &own) < 0 || getrusage(RUSAGE_CHILDREN, &children) < 0)
		return 0;
	return ((uint64_t)own.ru_maxrss + (uint64_t)children.ru_maxrss) * KIB;
}

int build_run(const struct build_options *options, struct crew *crew, struct build_report *ret,
	      struct why *why)
{
	struct build build = { .options = options, .crew = crew, .report = ret };
	uint64_t started_ns = clock_now_ns();
	int r;

	*ret = (struct build_report){ 0 };
	build.bucket_triangles = (uint32_t)u64_max(BUILD_BUCKET_TRIANGLES, options->leaf_triangles);
	progress_init(&build.progress, options->progress);
	r = judge_output(options->output, why);
	if (r == 0)
		r = find_scratch(&build, why);
	if (r == 0)
		r = plan_memory(&build, why);
	if (r == 0)
		r = run_phases(&build, why);
	build_done(&build);
	progress_done(&build.progress);
	for (int i = 0; i < PHASE_COUNT_; i++)
		ret->phase_seconds[i] = (double)build.progress.phase_ns[i] / 1e9;
	ret->seconds = (double)(clock_now_ns() - started_ns) / 1e9;
	ret->peak_rss_bytes = peak_bytes();
	return r;
}
