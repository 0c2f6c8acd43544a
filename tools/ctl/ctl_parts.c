/* SPDX-License-Identifier: MIT */
#include <getopt.h>
#include <inttypes.h>
#include <stdio.h>

#include "formats/base/text.h"
#include "tools/ctl/ctl.h"

static const char help[] =
	"Usage: oocctl parts STORE [PATTERN] [--json]\n"
	"Lists the parts whose name, scene path or section matches a shell pattern; all without.\n"
	"\n"
	"      --json   an array of objects in place of a table\n"
	"      --help   this text\n"
	"\n"
	"Examples:\n"
	"  oocctl parts plant.ooc 'pump*'\n"
	"  oocctl parts plant.ooc --json | jq '.[].name'";

static void print_json_part(const struct store_names *names, uint64_t index, bool is_first)
{
	const struct store_part *part = &names->parts[index];

	printf("%s\n  {\"part\": %" PRIu64 ", \"triangles\": %" PRIu64 ", \"name\": ",
	       is_first ? "" : ",", index, part->triangle_count);
	text_write_json(stdout, ctl_string(names, part->name));
	fputs(", \"section\": ", stdout);
	text_write_json(stdout, ctl_string(names, names->sections[part->section].name));
	fputs(", \"scene_path\": ", stdout);
	text_write_json(stdout, ctl_string(names, part->scene_path));
	fputs(", \"material\": ", stdout);
	text_write_json(stdout, ctl_string(names, part->material));
	printf(", \"colour\": \"#%02x%02x%02x\"}", part->colour & 0xff, part->colour >> 8 & 0xff,
	       part->colour >> 16 & 0xff);
}

static void print_table_part(const struct store_names *names, uint64_t index)
{
	const struct store_part *part = &names->parts[index];

	printf("%8" PRIu64 " %12" PRIu64 "  %-24s  %s", index, part->triangle_count,
	       ctl_string(names, part->name),
	       ctl_string(names, names->sections[part->section].name));
	if (ctl_string(names, part->scene_path)[0])
		printf("  %s", ctl_string(names, part->scene_path));
	if (ctl_string(names, part->material)[0])
		printf("  [%s]", ctl_string(names, part->material));
	putchar('\n');
}

static void print_parts(const struct store_names *names, const char *pattern, bool json)
{
	uint64_t count = 0;

	if (json)
		putchar('[');
	else
		printf("%8s %12s  %-24s  %s\n", "part", "triangles", "name",
		       "section  scene path  [material]");
	for (uint64_t i = 0; i < names->header->part_count; i++) {
		if (pattern && !ctl_part_matches(names, i, pattern))
			continue;
		if (json)
			print_json_part(names, i, count == 0);
		else
			print_table_part(names, i);
		count++;
	}
	if (json)
		puts("\n]");
}

int ctl_parts(int argc, char **argv)
{
	struct ctl_store store;
	bool json = false;
	int status;

	status = ctl_parse_json(argc, argv, help, &json);
	if (status != CTL_OK)
		return status < 0 ? CTL_OK : status;
	if (argc - optind < 1 || argc - optind > 2)
		return ctl_usage("parts", "wants a store and at most one pattern");
	status = ctl_store_open(argv[optind], &store);
	if (status != CTL_OK)
		return status;
	print_parts(&store.names, argc - optind == 2 ? argv[optind + 1] : NULL, json);
	ctl_store_close(&store);
	return CTL_OK;
}
