/* SPDX-License-Identifier: MIT */
#include <dirent.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

#include "formats/base/bytes.h"
#include "formats/import/import.h"
#include "formats/import/number.h"
#include "formats/import/placement.h"
#include "formats/import/source.h"

/* Folders within folders: a loop of links is longer than that. */
#define FOLDER_DEPTH_MAX     40u
#define SCENE_HEADER         "file,m00,m01,m02,m03,m10,m11,m12,m13,m20,m21,m22,m23"
#define SCENE_LINE_BYTES_MAX MIB
/* Below it a placement flattens its model to nothing: relative to the cube of its largest entry. */
#define SINGULAR 1e-12

struct expansion {
	struct import_inputs *inputs;
	size_t capacity;
};

static int no_memory(struct why *why)
{
	return why_set(why, -ENOMEM, "no memory for the list of inputs");
}

/* Appends an input; the strings are copied. */
static int add_input(struct expansion *expansion, const char *path, const char *name,
		     const double *placement, struct why *why)
{
	struct import_inputs *inputs = expansion->inputs;
	struct import_input *input;

	if (inputs->input_count == expansion->capacity) {
		size_t capacity = expansion->capacity ? 2 * expansion->capacity : 64;
		struct import_input *grown =
			realloc(inputs->inputs, capacity * sizeof(*inputs->inputs));

		if (!grown)
			return no_memory(why);
		inputs->inputs = grown;
		expansion->capacity = capacity;
	}
	input = &inputs->inputs[inputs->input_count];
	*input = (struct import_input){
		.path = strdup(path),
		.name = strdup(name),
		.placed = placement != NULL,
		.placement = { 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0 },
	};
	if (!input->path || !input->name) {
		free(input->path);
		free(input->name);
		return no_memory(why);
	}
	if (placement)
		memcpy(input->placement, placement, sizeof(input->placement));
	inputs->input_count++;
	return 0;
}

void import_inputs_done(struct import_inputs *inputs)
{
	for (size_t i = 0; i < inputs->input_count; i++) {
		free(inputs->inputs[i].path);
		free(inputs->inputs[i].name);
	}
	free(inputs->inputs);
	*inputs = (struct import_inputs){ 0 };
}

static char *path_join(const char *folder, const char *name)
{
	size_t length = strlen(folder);
	char *path = NULL;

	if (asprintf(&path, "%s%s%s", folder, length > 0 && folder[length - 1] != '/' ? "/" : "",
		     name) < 0)
		return NULL;
	return path;
}

/* ---- folders ---- */

/* A folder on the way from the root to where the walk is. */
struct folder_level {
	const struct folder_level *up;
	dev_t device;
	ino_t inode;
	unsigned depth;
};

static int by_bytes(const struct dirent **a, const struct dirent **b)
{
	return strcmp((*a)->d_name, (*b)->d_name);
}

static int not_hidden(const struct dirent *entry)
{
	return entry->d_name[0] != '.';
}

/* A link to a folder that the walk is in would never end. */
static bool is_loop(const struct folder_level *up, const struct stat *status)
{
	for (; up; up = up->up)
		if (up->device == status->st_dev && up->inode == status->st_ino)
			return true;
	return false;
}

static int add_folder(struct expansion *expansion, const char *path, size_t root_length,
		      const struct folder_level *up, struct why *why);

static int add_folder_entry(struct expansion *expansion, const char *path, size_t root_length,
			    const struct folder_level *level, struct why *why)
{
	struct stat status;

	/* A link to nowhere is no input. */
	if (stat(path, &status) < 0)
		return errno == ENOENT || errno == ELOOP ? 0 : why_errno(why, -errno, "%s", path);
	if (S_ISDIR(status.st_mode))
		return is_loop(level, &status)
			       ? 0
			       : add_folder(expansion, path, root_length, level, why);
	if (!S_ISREG(status.st_mode) || !import_is_model_name(path))
		return 0;
	return add_input(expansion, path, path + root_length, NULL, why);
}

static int add_folder(struct expansion *expansion, const char *path, size_t root_length,
		      const struct folder_level *up, struct why *why)
{
	struct folder_level level = { .up = up, .depth = up ? up->depth + 1 : 0 };
	struct dirent **entries;
	struct stat status;
	int count, r = 0;

	if (level.depth >= FOLDER_DEPTH_MAX)
		return why_set(why, -ELOOP, "%s: more than %u folders deep", path,
			       FOLDER_DEPTH_MAX);
	if (stat(path, &status) < 0)
		return why_errno(why, -errno, "%s", path);
	level.device = status.st_dev;
	level.inode = status.st_ino;
	count = scandir(path, &entries, not_hidden, by_bytes);
	if (count < 0)
		return why_errno(why, -errno, "%s: cannot read the folder", path);
	for (int i = 0; i < count; i++) {
		if (r == 0) {
			char *entry_path = path_join(path, entries[i]->d_name);

			r = entry_path ? add_folder_entry(expansion, entry_path, root_length,
							  &level, why)
				       : no_memory(why);
			free(entry_path);
		}
		free(entries[i]);
	}
	free(entries);
	return r;
}

static int by_path(const void *a, const void *b)
{
	return strcmp(((const struct import_input *)a)->path,
		      ((const struct import_input *)b)->path);
}

static int add_root_folder(struct expansion *expansion, const char *path, struct why *why)
{
	size_t first = expansion->inputs->input_count;
	size_t length = strlen(path);
	int r;

	r = add_folder(expansion, path, length + (path[length - 1] != '/'), NULL, why);
	/* "a-b" comes before "a/b" by the bytes of whole paths, but not folder by folder. */
	if (r == 0 && expansion->inputs->input_count > first)
		qsort(expansion->inputs->inputs + first, expansion->inputs->input_count - first,
		      sizeof(*expansion->inputs->inputs), by_path);
	return r;
}

/* ---- scene lists ---- */

static bool is_scene_list_name(const char *path)
{
	size_t length = strlen(path);

	return length > 4 && strcasecmp(path + length - 4, ".csv") == 0;
}

/*
 * Takes the first field of a line, quoted or not, unquoted in place.  Returns what follows its
 * comma, or NULL.
 */
static char *take_file_field(char *line, char **ret_file)
{
	char *to = line, *from = line;

	*ret_file = line;
	if (*from != '"') {
		from = strchr(from, ',');
		if (!from)
			return NULL;
		*from = '\0';
		return from + 1;
	}
	for (from++; *from; from++) {
		/* A quote within quotes is doubled. */
		if (*from == '"' && *++from != '"')
			break;
		*to++ = *from;
	}
	if (*from != ',')
		return NULL;
	*to = '\0';
	return from + 1;
}

static bool is_singular(const struct placement *placement)
{
	double largest = 0.0, cofactors[9];

	for (int row = 0; row < 3; row++)
		for (int column = 0; column < 3; column++)
			largest = fmax(largest, fabs(placement->m[4 * row + column]));
	return !(fabs(placement_cofactors(placement, cofactors)) >
		 SINGULAR * largest * largest * largest);
}

/* Reads the twelve numbers.  Returns NULL, or what is wrong. */
static const char *take_placement(const char *text, struct placement *placement)
{
	for (int i = 0; i < 12; i++) {
		while (*text == ' ' || *text == '\t')
			text++;
		text = number_to_double(text, &placement->m[i]);
		if (!text)
			return "twelve numbers are wanted behind the file";
		while (*text == ' ' || *text == '\t')
			text++;
		if (*text != (i < 11 ? ',' : '\0'))
			return "twelve numbers are wanted behind the file, with commas between";
		if (!isfinite(placement->m[i]))
			return "the matrix has a number that is not finite";
		text += i < 11;
	}
	return is_singular(placement) ? "the matrix is singular: it would flatten the model" : NULL;
}

static int add_scene_line(struct expansion *expansion, const char *folder, char *line,
			  const char **ret_fault, struct why *why)
{
	struct placement placement;
	char *file, *path;
	char *rest = take_file_field(line, &file);
	int r;

	*ret_fault = NULL;
	if (!rest || *file == '\0')
		*ret_fault = "\"file,m00,...,m23\" is wanted";
	else
		*ret_fault = take_placement(rest, &placement);
	if (*ret_fault)
		return 0;
	path = *file == '/' ? strdup(file) : path_join(folder, file);
	if (!path)
		return no_memory(why);
	if (!import_is_model_name(path))
		*ret_fault = "no importer knows a file of this name";
	else if (access(path, R_OK) < 0)
		*ret_fault = "its file cannot be read";
	r = *ret_fault ? 0 : add_input(expansion, path, file, placement.m, why);
	free(path);
	return r;
}

/* Each line of an open list. */
static int add_scene_lines(struct expansion *expansion, struct source *source, const char *folder,
			   struct why *why)
{
	const char *text, *fault = NULL;
	bool header_seen = false;
	size_t length;
	int r;

	while ((r = source_line(source, &text, &length, why)) > 0) {
		char *line;

		while (length > 0 && source_is_blank((uint8_t)text[length - 1]))
			length--;
		if (length == 0)
			continue;
		line = strndup(text, length);
		if (!line)
			return no_memory(why);
		if (header_seen)
			r = add_scene_line(expansion, folder, line, &fault, why);
		else if (strcmp(line, SCENE_HEADER) != 0)
			fault = "a scene list begins with \"" SCENE_HEADER "\"";
		header_seen = true;
		free(line);
		if (fault)
			return why_set(why, -EUCLEAN, "line %llu: %s",
				       (unsigned long long)source->line, fault);
		if (r < 0)
			return r;
	}
	if (r == 0 && !header_seen)
		return why_set(why, -EUCLEAN, "the scene list is empty");
	return r;
}

static int add_scene_list(struct expansion *expansion, const char *path, struct why *why)
{
	const char *slash = strrchr(path, '/');
	char *folder = slash ? strndup(path, (size_t)(slash - path) + 1) : strdup("");
	struct source *source = NULL;
	int r;

	if (!folder)
		return no_memory(why);
	r = source_open(path, SCENE_LINE_BYTES_MAX, NULL, NULL, &source, why);
	if (r == 0)
		r = add_scene_lines(expansion, source, folder, why);
	if (r < 0)
		why_prefix(why, "%s", path);
	source_close(source);
	free(folder);
	return r;
}

int import_inputs_expand(char *const *arguments, size_t argument_count, struct import_inputs *ret,
			 struct why *why)
{
	struct import_inputs inputs = { 0 };
	struct expansion expansion = { .inputs = &inputs };
	int r = 0;

	for (size_t i = 0; i < argument_count && r == 0; i++) {
		const char *path = arguments[i];
		struct stat status;

		if (stat(path, &status) < 0)
			r = why_errno(why, -errno, "%s", path);
		else if (S_ISDIR(status.st_mode))
			r = add_root_folder(&expansion, path, why);
		else if (is_scene_list_name(path))
			r = add_scene_list(&expansion, path, why);
		else
			r = add_input(&expansion, path, path, NULL, why);
	}
	if (r < 0) {
		import_inputs_done(&inputs);
		return r;
	}
	*ret = inputs;
	return 0;
}
