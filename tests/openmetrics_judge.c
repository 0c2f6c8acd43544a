/* SPDX-License-Identifier: MIT */
#include "tests/openmetrics_judge.h"

#include <ctype.h>
#include <errno.h>
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define NAME_BYTES   128
#define FAMILIES_MAX 256
#define LABELS_BYTES 256

/** The family whose lines are being read. */
struct family {
	char name[NAME_BYTES];
	char type[NAME_BYTES];
	bool has_help;
	double bucket;     /* the last one's count; -1: none yet */
	bool has_infinity; /* and it was the last */
};

struct judge {
	struct family family;
	char names[FAMILIES_MAX][NAME_BYTES];
	size_t family_count;
	bool ended;
};

static bool is_name(const char *name)
{
	if (!isalpha((unsigned char)name[0]) && name[0] != '_')
		return false;
	for (; *name; name++)
		if (!isalnum((unsigned char)*name) && *name != '_')
			return false;
	return true;
}

static const char *judge_type(struct judge *judge, const char *name, const char *type)
{
	static const char *const types[] = { "counter", "gauge", "histogram", "info" };
	bool known = false;

	for (size_t i = 0; i < 4; i++)
		known = known || strcmp(type, types[i]) == 0;
	if (!known)
		return "a type that is none of ours";
	if (!is_name(name))
		return "no name";
	for (size_t i = 0; i < judge->family_count; i++)
		if (strcmp(judge->names[i], name) == 0)
			return "a family for the second time";
	if (judge->family_count == FAMILIES_MAX)
		return "more families than the judge knows";
	if (strcmp(judge->family.type, "histogram") == 0 && !judge->family.has_infinity)
		return "the histogram before ends without a bucket for the rest";
	(void)strcpy(judge->names[judge->family_count++], name);
	judge->family = (struct family){ .bucket = -1 };
	(void)strcpy(judge->family.name, name);
	(void)strcpy(judge->family.type, type);
	return NULL;
}

static const char *judge_unit(const struct judge *judge, const char *name, const char *unit)
{
	size_t name_length = strlen(name);
	size_t unit_length = strlen(unit);

	if (strcmp(name, judge->family.name) != 0)
		return "a unit of another family";
	if (name_length < unit_length + 2 || name[name_length - unit_length - 1] != '_' ||
	    strcmp(name + name_length - unit_length, unit) != 0)
		return "a unit that the name does not end with";
	return NULL;
}

static const char *judge_comment(struct judge *judge, const char *line)
{
	char name[NAME_BYTES];
	char word[NAME_BYTES];
	char more;

	if (strcmp(line, "# EOF") == 0) {
		judge->ended = true;
		return NULL;
	}
	if (sscanf(line, "# TYPE %127s %127s%c", name, word, &more) == 2)
		return judge_type(judge, name, word);
	if (sscanf(line, "# UNIT %127s %127s%c", name, word, &more) == 2)
		return judge_unit(judge, name, word);
	if (sscanf(line, "# HELP %127s %127[^\n]", name, word) == 2) {
		judge->family.has_help = true;
		return strcmp(name, judge->family.name) == 0 ? NULL : "help of another family";
	}
	return "a comment that is none";
}

/* le="0.5" or le="+Inf", alone or behind other labels. */
static const char *judge_bucket(struct family *family, const char *labels, double value)
{
	const char *bound = strstr(labels, "le=\"");

	if (!bound)
		return "a bucket without a bound";
	if (strncmp(bound, "le=\"+Inf\"", 9) == 0) {
		family->has_infinity = true;
		if (value < family->bucket)
			return "a bucket with less than the one before";
		family->bucket = -1;
		return NULL;
	}
	family->has_infinity = false;
	if (value < family->bucket)
		return "a bucket with less than the one before";
	family->bucket = value;
	return NULL;
}

static const char *judge_suffix(struct family *family, const char *suffix, const char *labels,
				double value)
{
	if (strcmp(family->type, "counter") == 0)
		return strcmp(suffix, "_total") == 0 && value >= 0 ? NULL : "no count of a counter";
	if (strcmp(family->type, "info") == 0)
		return strcmp(suffix, "_info") == 0 && value == 1 ? NULL : "no info";
	if (strcmp(family->type, "gauge") == 0)
		return suffix[0] == '\0' ? NULL : "a gauge with a suffix";
	if (strcmp(suffix, "_bucket") == 0)
		return judge_bucket(family, labels, value);
	return strcmp(suffix, "_count") == 0 || strcmp(suffix, "_sum") == 0
		       ? NULL
		       : "no sample of a histogram";
}

static const char *judge_sample(struct judge *judge, const char *line)
{
	size_t length = strlen(judge->family.name);
	char suffix[NAME_BYTES] = "";
	char labels[LABELS_BYTES] = "";
	double value;
	int used = 0;

	if (length == 0 || strncmp(line, judge->family.name, length) != 0)
		return "a sample of another family";
	if (!judge->family.has_help)
		return "a family without help";
	line += length;
	if (*line == '_') {
		(void)sscanf(line, "%127[a-z_]%n", suffix, &used);
		line += used;
	}
	if (*line == '{') {
		used = 0;
		if (sscanf(line, "{%255[^}]}%n", labels, &used) != 1 || used == 0)
			return "labels that do not end";
		line += used;
	}
	used = 0;
	if (sscanf(line, " %lf%n", &value, &used) != 1 || line[used] != '\0' || !isfinite(value))
		return "no number";
	return judge_suffix(&judge->family, suffix, labels, value);
}

int openmetrics_judge(const char *text, struct why *why)
{
	static struct judge judge;
	char *copy = strdup(text);
	unsigned line_number = 0;

	judge = (struct judge){ 0 };
	if (text[0] == '\0' || text[strlen(text) - 1] != '\n') {
		free(copy);
		return why_set(why, -EINVAL, "no newline at its end");
	}
	for (char *line = copy, *end; *line; line = end + 1) {
		const char *fault;

		end = strchr(line, '\n');
		*end = '\0';
		line_number++;
		if (judge.ended)
			fault = "something behind the end";
		else
			fault = line[0] == '#' ? judge_comment(&judge, line)
					       : judge_sample(&judge, line);
		if (fault) {
			int r = why_set(why, -EINVAL, "line %u: %s: %s", line_number, line, fault);

			free(copy);
			return r;
		}
	}
	free(copy);
	return judge.ended ? 0 : why_set(why, -EINVAL, "no # EOF");
}

double openmetrics_value(const char *text, const char *sample)
{
	size_t length = strlen(sample);

	for (const char *line = text; *line; line = strchr(line, '\n') + 1)
		if (strncmp(line, sample, length) == 0 && line[length] == ' ')
			return strtod(line + length, NULL);
	return -1;
}
