/* SPDX-License-Identifier: MIT */
#include "tools/build/summary.h"

#include <inttypes.h>

#include "formats/base/bytes.h"
#include "formats/base/text.h"

static double a_triangle(const struct build_report *report, uint64_t count)
{
	return report->triangles_stored > 0 ? (double)count / (double)report->triangles_stored : 0;
}

static void print_drops(const struct build_report *report, FILE *out)
{
	if (report->degenerate > 0)
		(void)fprintf(out, "  dropped   %" PRIu64 " triangles without area\n",
			      report->degenerate);
	if (report->non_finite > 0)
		(void)fprintf(out, "  dropped   %" PRIu64 " triangles that are not finite\n",
			      report->non_finite);
	if (report->dropped_faces > 0)
		(void)fprintf(out, "  dropped   %" PRIu64 " faces with fewer than three corners\n",
			      report->dropped_faces);
	if (report->duplicates > 0)
		(void)fprintf(out, "  kept      %" PRIu64 " triangles that are there twice\n",
			      report->duplicates);
	if (report->depth_limited_leaves > 0)
		(void)fprintf(out,
			      "  note      %" PRIu64 " leaves share a cell that could not be cut\n",
			      report->depth_limited_leaves);
	if (report->missing_material_file)
		(void)fputs("  note      a material file is missing: grey stands in\n", out);
	if (report->missing_textures > 0)
		(void)fprintf(out,
			      "  note      %" PRIu64
			      " images cannot be read: their materials' colours stand in\n",
			      report->missing_textures);
	if (report->units_differ)
		(void)fputs("  note      files differ in units or up axis: the first one counts\n",
			    out);
}

void summary_print(const struct build_options *options, const struct build_report *report,
		   FILE *out)
{
	char bytes[TEXT_SIZE_BYTES];
	char largest[TEXT_SIZE_BYTES];
	char memory[TEXT_SIZE_BYTES];
	char scratch[TEXT_SIZE_BYTES];

	(void)fprintf(out, "%s: %" PRIu64 " triangles in %" PRIu64 " leaves, %s\n", options->output,
		      report->triangles_stored, report->leaves,
		      text_from_size(report->bytes, bytes));
	(void)fprintf(
		out, "  read      %" PRIu64 " triangles, %" PRIu64 " sections, %" PRIu64 " parts\n",
		report->triangles_in, report->sections, report->parts);
	print_drops(report, out);
	if (report->replication_factor > 1)
		(void)fprintf(out, "  replicas  x %.3f\n", report->replication_factor);
	if (report->step > 0)
		(void)fprintf(out, "  positions multiples of %g, moved by at most %.3g\n",
			      report->step, report->error_measured);
	else
		(void)fprintf(out, "  positions as in the files, moved by at most %.3g\n",
			      report->error_measured);
	(void)fprintf(out,
		      "  size      %.1f bytes and %.2f vertices a triangle, largest payload %s\n",
		      a_triangle(report, report->bytes), a_triangle(report, report->vertices),
		      text_from_size(report->largest_payload_bytes, largest));
	(void)fprintf(out, "  time      %.2f s, %.2f Mtriangles/s, %s of memory, %s of scratch\n",
		      report->seconds,
		      (double)report->triangles_in / (report->seconds > 0 ? report->seconds : 1) /
			      1e6,
		      text_from_size(report->peak_rss_bytes, memory),
		      text_from_size(report->scratch_bytes, scratch));
}

/** A number of the report and its name in JSON. */
struct count_field {
	const char *name;
	uint64_t value;
};

static void print_counts(const struct build_report *report, FILE *out)
{
	const struct count_field fields[] = {
		{ "triangles_in", report->triangles_in },
		{ "triangles_stored", report->triangles_stored },
		{ "degenerate", report->degenerate },
		{ "non_finite", report->non_finite },
		{ "duplicates", report->duplicates },
		{ "dropped_faces", report->dropped_faces },
		{ "missing_textures", report->missing_textures },
		{ "sections", report->sections },
		{ "parts", report->parts },
		{ "nodes", report->nodes },
		{ "leaves", report->leaves },
		{ "small_leaves", report->small_leaves },
		{ "depth_limited_leaves", report->depth_limited_leaves },
		{ "vertices", report->vertices },
		{ "bytes", report->bytes },
		{ "hs_bytes", report->hs_bytes },
		{ "names_bytes", report->names_bytes },
		{ "payload_bytes", report->payload_bytes },
		{ "largest_payload_bytes", report->largest_payload_bytes },
		{ "peak_rss_bytes", report->peak_rss_bytes },
		{ "scratch_bytes", report->scratch_bytes },
		{ "generation", report->generation },
		{ "buckets", report->buckets },
		{ "workers", report->workers },
	};

	for (size_t i = 0; i < ARRAY_LENGTH(fields); i++)
		(void)fprintf(out, "  \"%s\": %" PRIu64 ",\n", fields[i].name, fields[i].value);
}

void summary_print_json(const struct build_options *options, const struct build_report *report,
			FILE *out)
{
	(void)fputs("{\n  \"store\": ", out);
	text_write_json(out, options->output);
	(void)fputs(",\n", out);
	print_counts(report, out);
	(void)fprintf(out, "  \"replication_factor\": %.9g,\n", report->replication_factor);
	(void)fprintf(out, "  \"error\": %.17g,\n", report->error);
	(void)fprintf(out, "  \"error_measured\": %.17g,\n", report->error_measured);
	(void)fprintf(out, "  \"step\": %.17g,\n", report->step);
	(void)fprintf(out, "  \"unit_metres\": %.17g,\n", report->unit_metres);
	(void)fprintf(out, "  \"up_axis\": %d,\n", (int)report->up_axis);
	(void)fprintf(out, "  \"missing_material_file\": %s,\n",
		      report->missing_material_file ? "true" : "false");
	(void)fprintf(out, "  \"units_differ\": %s,\n", report->units_differ ? "true" : "false");
	(void)fprintf(out, "  \"seconds\": %.6f,\n  \"phases\": {", report->seconds);
	for (int i = 0; i < PHASE_COUNT_; i++)
		(void)fprintf(out, "%s\"%s\": %.6f", i > 0 ? ", " : " ",
			      build_phase_name((enum build_phase)i), report->phase_seconds[i]);
	(void)fputs(" }\n}\n", out);
}
