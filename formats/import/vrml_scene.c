/* SPDX-License-Identifier: MIT */
#include "formats/import/vrml_scene.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"

#define WORD_BYTES 256u

enum token {
	TOKEN_END,
	TOKEN_OPEN,  /* { */
	TOKEN_CLOSE, /* } */
	TOKEN_LIST,  /* [ or ]: lists need no bookkeeping, nodes within them do */
	TOKEN_STRING,
	TOKEN_WORD, /* a keyword, a name, a number */
};

static const struct {
	const char *name;
	enum vrml_kind kind;
} node_names[] = {
	{ "Shape", VRML_SHAPE },
	{ "IndexedFaceSet", VRML_FACES },
	{ "Coordinate", VRML_COORDINATE },
	{ "Appearance", VRML_APPEARANCE },
	{ "Material", VRML_MATERIAL },
	{ "Color", VRML_COLOUR },
	{ "Normal", VRML_NORMAL },
	{ "Group", VRML_GROUP },
	{ "Transform", VRML_TRANSFORM },
	{ "Switch", VRML_SWITCH },
	{ "LOD", VRML_LOD },
	{ "Anchor", VRML_GROUP },
	{ "Billboard", VRML_GROUP },
	{ "Collision", VRML_GROUP },
};

/* ---- words ---- */

static int scene_fault(const struct vrml_scene *scene, struct why *why, const char *what)
{
	return why_set(why, -EUCLEAN, "line %llu: %s", (unsigned long long)scene->source->line + 1,
		       what);
}

static int scene_cut(const struct vrml_scene *scene, struct why *why)
{
	return why_set(why, -ENODATA, "line %llu: it ends too early",
		       (unsigned long long)scene->source->line + 1);
}

/* Passes over blanks, commas and comments.  Returns 1 at something else, 0 at the end. */
static int skip_gaps(struct source *source, struct why *why)
{
	for (;;) {
		const char *comment;
		size_t length;
		int r;

		while (*source->at == ',')
			source->at++;
		if (*source->at > ' ' && *source->at != '#')
			return 1;
		r = source_blanks(source, why);
		if (r <= 0)
			return r;
		if (*source->at == ',')
			continue;
		if (*source->at != '#')
			return 1;
		r = source_line(source, &comment, &length, why);
		if (r < 0)
			return r;
	}
}

static bool ends_word(uint8_t byte)
{
	return byte <= ' ' || strchr(",{}[]\"#", byte);
}

/* Behind the opening quote. */
static int skip_string(struct source *source, struct why *why)
{
	bool escaped = false;

	for (;;) {
		uint8_t byte;
		int r = source_need(source, 1, why);

		if (r < 0)
			return r;
		byte = *source->at++;
		source->line += byte == '\n';
		if (byte == '"' && !escaped)
			return 0;
		escaped = byte == '\\' && !escaped;
	}
}

static int take_word(struct vrml_scene *scene, char word[WORD_BYTES], struct why *why)
{
	struct source *source = scene->source;
	size_t length = 0;

	for (;;) {
		int r;

		while (!ends_word(*source->at)) {
			if (length == WORD_BYTES - 1)
				return scene_fault(scene, why, "a word of more than 255 letters");
			word[length++] = (char)*source->at++;
		}
		if (source->at < source->end)
			break;
		r = source_more(source, why);
		if (r < 0)
			return r;
		if (r == 0)
			break;
	}
	word[length] = '\0';
	return 0;
}

/* Takes what comes next; the word is set for TOKEN_WORD.  Returns enum token or an error. */
static int next_token(struct vrml_scene *scene, char word[WORD_BYTES], struct why *why)
{
	struct source *source = scene->source;
	int r = skip_gaps(source, why);

	if (r <= 0)
		return r < 0 ? r : TOKEN_END;
	switch (*source->at) {
	case '{':
		source->at++;
		return TOKEN_OPEN;
	case '}':
		source->at++;
		return TOKEN_CLOSE;
	case '[':
	case ']':
		source->at++;
		return TOKEN_LIST;
	case '"':
		source->at++;
		r = skip_string(source, why);
		return r < 0 ? r : TOKEN_STRING;
	default:
		if (*source->at < ' ')
			return scene_fault(scene, why, "a byte that no text has");
		r = take_word(scene, word, why);
		return r < 0 ? r : TOKEN_WORD;
	}
}

/* Does "{" come next?  Then it is taken. */
static int take_open(struct vrml_scene *scene, struct why *why)
{
	int r = skip_gaps(scene->source, why);

	if (r <= 0)
		return r;
	if (*scene->source->at != '{')
		return 0;
	scene->source->at++;
	return 1;
}

/* ---- memory ---- */

/* Counts memory before it is taken. */
static int scene_charge(struct vrml_scene *scene, uint64_t size_bytes, struct why *why)
{
	if (size_bytes > scene->bytes_max - scene->used_bytes)
		return why_set(why, -ENOMEM,
			       "its scene does not fit in %llu MiB: convert it to PLY or OBJ first",
			       (unsigned long long)(scene->bytes_max / MIB));
	scene->used_bytes += size_bytes;
	return 0;
}

/* Makes an array longer. */
static int scene_grow(struct vrml_scene *scene, void **array, uint64_t *capacity, size_t item_bytes,
		      struct why *why)
{
	uint64_t wanted = *capacity ? *capacity + *capacity / 2 : 4;
	void *grown;
	int r = scene_charge(scene, (wanted - *capacity) * item_bytes, why);

	if (r < 0)
		return r;
	grown = realloc(*array, wanted * item_bytes);
	if (!grown)
		return why_set(why, -ENOMEM, "no memory for its scene");
	*array = grown;
	*capacity = wanted;
	return 0;
}

static int scene_add_node(struct vrml_scene *scene, enum vrml_kind kind, struct vrml_node **ret,
			  struct why *why)
{
	struct vrml_node *node;
	int r = scene_charge(scene, sizeof(*node), why);

	if (r < 0)
		return r;
	node = malloc(sizeof(*node));
	if (!node)
		return why_set(why, -ENOMEM, "no memory for its scene");
	*node = (struct vrml_node){ .kind = kind, .name = "", .next_made = scene->made };
	if (kind == VRML_TRANSFORM) {
		for (int k = 0; k < 3; k++)
			node->transform.scale[k] = 1.0;
		node->transform.rotation[2] = 1.0;
		node->transform.scale_orientation[2] = 1.0;
	} else if (kind == VRML_MATERIAL) {
		for (int k = 0; k < 3; k++)
			node->material.diffuse[k] = 0.8;
	} else if (kind == VRML_SWITCH) {
		node->which_choice = -1;
	}
	scene->made = node;
	scene->node_count++;
	*ret = node;
	return 0;
}

static int node_attach(struct vrml_scene *scene, struct vrml_node *node, struct vrml_node *child,
		       struct why *why)
{
	if (node->child_count == node->child_capacity) {
		int r = scene_grow(scene, (void **)&node->children, &node->child_capacity,
				   sizeof(struct vrml_node *), why);

		if (r < 0)
			return r;
	}
	node->children[node->child_count++] = child;
	return 0;
}

const struct vrml_node *vrml_node_find(const struct vrml_node *node, enum vrml_kind kind)
{
	for (uint64_t i = 0; i < node->child_count; i++)
		if (node->children[i]->kind == kind)
			return node->children[i];
	return NULL;
}

void vrml_scene_done(struct vrml_scene *scene)
{
	struct vrml_node *node = scene->made;

	while (node) {
		struct vrml_node *next = node->next_made;

		free(node->children);
		if (node->kind == VRML_FACES) {
			free(node->faces.coord_index.values);
			free(node->faces.colour_index.values);
			free(node->faces.normal_index.values);
		} else if (node->kind == VRML_COORDINATE || node->kind == VRML_COLOUR ||
			   node->kind == VRML_NORMAL) {
			free(node->floats.values);
		}
		free(node);
		node = next;
	}
	names_done(&scene->names);
	free(scene->defined);
	*scene = (struct vrml_scene){ 0 };
}

/* ---- fields ---- */

static int take_doubles(struct vrml_scene *scene, double *values, int count, struct why *why)
{
	for (int i = 0; i < count; i++) {
		int r = skip_gaps(scene->source, why);

		if (r == 0)
			return scene_cut(scene, why);
		if (r > 0)
			r = source_double(scene->source, &values[i], why);
		if (r < 0)
			return r;
	}
	return 0;
}

static int take_bool(struct vrml_scene *scene, bool *ret, struct why *why)
{
	char word[WORD_BYTES];
	int r = next_token(scene, word, why);

	if (r < 0)
		return r;
	if (r != TOKEN_WORD)
		return scene_fault(scene, why, "TRUE or FALSE is wanted");
	*ret = strcmp(word, "TRUE") == 0;
	return 0;
}

/*
 * Begins a list of numbers: 1 when it stands in brackets, 0 when it is a single value without.
 */
static int begin_list(struct vrml_scene *scene, struct why *why)
{
	int r = skip_gaps(scene->source, why);

	if (r <= 0)
		return r < 0 ? r : scene_cut(scene, why);
	if (*scene->source->at != '[')
		return 0;
	scene->source->at++;
	return 1;
}

/* Is there another number of the list?  Takes the bracket that ends it. */
static int list_goes_on(struct vrml_scene *scene, struct why *why)
{
	int r = skip_gaps(scene->source, why);

	if (r <= 0)
		return r < 0 ? r : scene_cut(scene, why);
	if (*scene->source->at != ']')
		return 1;
	scene->source->at++;
	return 0;
}

static int take_float_list(struct vrml_scene *scene, struct vrml_floats *floats, struct why *why)
{
	int bracketed = begin_list(scene, why);
	int r = bracketed;

	floats->count = 0;
	while (r >= 0) {
		r = bracketed ? list_goes_on(scene, why) : floats->count < 3;
		if (r <= 0)
			break;
		if (floats->count == floats->capacity) {
			r = scene_grow(scene, (void **)&floats->values, &floats->capacity,
				       sizeof(float), why);
			if (r < 0)
				break;
		}
		r = skip_gaps(scene->source, why);
		if (r >= 0)
			r = source_float(scene->source, &floats->values[floats->count++], why);
	}
	return r;
}

static int take_index_list(struct vrml_scene *scene, struct vrml_indices *indices, struct why *why)
{
	int bracketed = begin_list(scene, why);
	int r = bracketed;

	indices->count = 0;
	while (r >= 0) {
		int64_t index;

		r = bracketed ? list_goes_on(scene, why) : indices->count < 1;
		if (r <= 0)
			break;
		if (indices->count == indices->capacity) {
			r = scene_grow(scene, (void **)&indices->values, &indices->capacity,
				       sizeof(int32_t), why);
			if (r < 0)
				break;
		}
		r = source_i64(scene->source, &index, why);
		if (r < 0)
			break;
		/* What is out of reach becomes a number that no array has. */
		indices->values[indices->count++] =
			index < -1 || index > INT32_MAX ? INT32_MAX : (int32_t)index;
	}
	return r;
}

static int take_faces_field(struct vrml_scene *scene, struct vrml_node *node, const char *field,
			    struct why *why)
{
	bool value;
	int r;

	if (strcmp(field, "coordIndex") == 0)
		return take_index_list(scene, &node->faces.coord_index, why);
	if (strcmp(field, "colorIndex") == 0)
		return take_index_list(scene, &node->faces.colour_index, why);
	if (strcmp(field, "normalIndex") == 0)
		return take_index_list(scene, &node->faces.normal_index, why);
	if (strcmp(field, "ccw") == 0) {
		r = take_bool(scene, &value, why);
		node->faces.clockwise = r == 0 && !value;
		return r;
	}
	if (strcmp(field, "colorPerVertex") == 0) {
		r = take_bool(scene, &value, why);
		node->faces.colour_per_face = r == 0 && !value;
		return r;
	}
	if (strcmp(field, "normalPerVertex") == 0) {
		r = take_bool(scene, &value, why);
		node->faces.normal_per_face = r == 0 && !value;
		return r;
	}
	return 0;
}

static int take_transform_field(struct vrml_scene *scene, struct vrml_node *node, const char *field,
				struct why *why)
{
	if (strcmp(field, "translation") == 0)
		return take_doubles(scene, node->transform.translation, 3, why);
	if (strcmp(field, "rotation") == 0)
		return take_doubles(scene, node->transform.rotation, 4, why);
	if (strcmp(field, "scale") == 0)
		return take_doubles(scene, node->transform.scale, 3, why);
	if (strcmp(field, "scaleOrientation") == 0)
		return take_doubles(scene, node->transform.scale_orientation, 4, why);
	if (strcmp(field, "center") == 0)
		return take_doubles(scene, node->transform.centre, 3, why);
	return 0;
}

/* A word within a node: reads its value if it is a field that counts there. */
static int take_field(struct vrml_scene *scene, struct vrml_node *node, const char *field,
		      struct why *why)
{
	double choice;
	int r;

	switch (node->kind) {
	case VRML_FACES:
		return take_faces_field(scene, node, field, why);
	case VRML_TRANSFORM:
		return take_transform_field(scene, node, field, why);
	case VRML_COORDINATE:
		if (strcmp(field, "point") == 0)
			return take_float_list(scene, &node->floats, why);
		return 0;
	case VRML_COLOUR:
		if (strcmp(field, "color") == 0)
			return take_float_list(scene, &node->floats, why);
		return 0;
	case VRML_NORMAL:
		if (strcmp(field, "vector") == 0)
			return take_float_list(scene, &node->floats, why);
		return 0;
	case VRML_MATERIAL:
		if (strcmp(field, "diffuseColor") == 0)
			return take_doubles(scene, node->material.diffuse, 3, why);
		if (strcmp(field, "transparency") == 0)
			return take_doubles(scene, &node->material.transparency, 1, why);
		return 0;
	case VRML_SWITCH:
		if (strcmp(field, "whichChoice") != 0)
			return 0;
		r = take_doubles(scene, &choice, 1, why);
		node->which_choice = r == 0 && choice >= 0.0 && choice < 1e9 ? (int32_t)choice : -1;
		return r;
	case VRML_OTHER:
	case VRML_GROUP:
	case VRML_LOD:
	case VRML_SHAPE:
	case VRML_APPEARANCE:
		break;
	}
	return 0;
}

/* ---- nodes ---- */

/* Passes over brackets of both kinds, from behind the first that opens to its end. */
static int skip_balanced(struct vrml_scene *scene, struct why *why)
{
	char word[WORD_BYTES];
	uint64_t depth = 1;

	while (depth > 0) {
		bool list_end = false;
		int r = skip_gaps(scene->source, why);

		if (r > 0) {
			list_end = *scene->source->at == ']';
			r = next_token(scene, word, why);
		}
		if (r < 0)
			return r;
		if (r == TOKEN_END)
			return scene_cut(scene, why);
		if (r == TOKEN_OPEN || (r == TOKEN_LIST && !list_end))
			depth++;
		else if (r == TOKEN_CLOSE || r == TOKEN_LIST)
			depth--;
	}
	return 0;
}

/* "PROTO Name [ ... ] { ... }", behind its first word. */
static int skip_prototype(struct vrml_scene *scene, struct why *why)
{
	char word[WORD_BYTES];
	int r = next_token(scene, word, why);

	if (r == TOKEN_WORD)
		r = next_token(scene, word, why);
	if (r < 0)
		return r;
	if (r != TOKEN_LIST)
		return scene_fault(scene, why, "\"PROTO Name [\" is wanted");
	r = skip_balanced(scene, why);
	if (r == 0)
		r = take_open(scene, why);
	if (r < 0)
		return r;
	if (r == 0)
		return scene_fault(scene, why, "the body of a PROTO is wanted");
	return skip_balanced(scene, why);
}

static int define(struct vrml_scene *scene, const char *name, struct vrml_node *node,
		  struct why *why)
{
	uint32_t number;
	int r = names_add(&scene->names, name, &number, why);

	if (r < 0)
		return r;
	if (number >= scene->defined_capacity) {
		uint32_t capacity = scene->defined_capacity ? 2 * scene->defined_capacity : 64;
		struct vrml_node **grown =
			realloc(scene->defined, capacity * sizeof(struct vrml_node *));

		if (!grown)
			return why_set(why, -ENOMEM, "no memory for its names");
		scene->defined = grown;
		scene->defined_capacity = capacity;
	}
	scene->defined[number] = node;
	node->name = names_text(&scene->names, name);
	return 0;
}

static int take_node(struct vrml_scene *scene, const char *type, unsigned depth,
		     struct vrml_node **ret, struct why *why);

/* "DEF Name Type {": the name counts from behind the node, so that none is within itself. */
static int take_definition(struct vrml_scene *scene, struct vrml_node *parent, unsigned depth,
			   struct why *why)
{
	char name[WORD_BYTES], type[WORD_BYTES];
	struct vrml_node *node;
	int r = next_token(scene, name, why);

	if (r == TOKEN_WORD)
		r = next_token(scene, type, why);
	if (r == TOKEN_WORD)
		r = take_open(scene, why);
	else if (r >= 0)
		r = 0;
	if (r < 0)
		return r;
	if (r == 0)
		return scene_fault(scene, why, "\"DEF Name Type {\" is wanted");
	r = take_node(scene, type, depth, &node, why);
	if (r == 0)
		r = define(scene, name, node, why);
	return r < 0 ? r : node_attach(scene, parent, node, why);
}

static int take_use(struct vrml_scene *scene, struct vrml_node *parent, struct why *why)
{
	char name[WORD_BYTES];
	uint32_t number;
	int r = next_token(scene, name, why);

	if (r < 0)
		return r;
	number = r == TOKEN_WORD ? names_find(&scene->names, name) : UINT32_MAX;
	if (number == UINT32_MAX)
		return scene_fault(scene, why, "USE of a name that has no DEF before it");
	return node_attach(scene, parent, scene->defined[number], why);
}

/* A word within a node: a statement, the type of a node, or a field. */
static int take_statement(struct vrml_scene *scene, struct vrml_node *node, const char *word,
			  unsigned depth, struct why *why)
{
	struct vrml_node *child;
	int r;

	if (strcmp(word, "USE") == 0)
		return take_use(scene, node, why);
	if (strcmp(word, "DEF") == 0)
		return take_definition(scene, node, depth + 1, why);
	if (strcmp(word, "PROTO") == 0)
		return skip_prototype(scene, why);
	r = take_open(scene, why);
	if (r < 0)
		return r;
	if (r == 0)
		return take_field(scene, node, word, why);
	r = take_node(scene, word, depth + 1, &child, why);
	return r < 0 ? r : node_attach(scene, node, child, why);
}

/* Takes what is in a node up to its "}", or up to the end of the file at the top. */
static int take_content(struct vrml_scene *scene, struct vrml_node *node, unsigned depth,
			struct why *why)
{
	for (;;) {
		char word[WORD_BYTES];
		int r = next_token(scene, word, why);

		if (r < 0)
			return r;
		switch ((enum token)r) {
		case TOKEN_END:
			return depth == 0 ? 0 : scene_cut(scene, why);
		case TOKEN_CLOSE:
			return depth > 0 ? 0 : scene_fault(scene, why, "a \"}\" too many");
		case TOKEN_OPEN:
			return scene_fault(scene, why, "a \"{\" without a node");
		case TOKEN_LIST:
		case TOKEN_STRING:
			break;
		case TOKEN_WORD:
			r = take_statement(scene, node, word, depth, why);
			if (r < 0)
				return r;
			break;
		}
	}
}

static int take_node(struct vrml_scene *scene, const char *type, unsigned depth,
		     struct vrml_node **ret, struct why *why)
{
	enum vrml_kind kind = VRML_OTHER;
	int r;

	if (depth > VRML_DEPTH_MAX)
		return scene_fault(scene, why, "nodes are nested more than 100 deep");
	for (size_t i = 0; i < ARRAY_LENGTH(node_names); i++) {
		if (strcmp(node_names[i].name, type) == 0) {
			kind = node_names[i].kind;
			break;
		}
	}
	r = scene_add_node(scene, kind, ret, why);
	if (r < 0)
		return r;
	scene->transformed |= kind == VRML_TRANSFORM;
	return take_content(scene, *ret, depth, why);
}

int vrml_scene_read(struct source *source, uint64_t bytes_max, struct vrml_scene *ret,
		    struct why *why)
{
	int r;

	*ret = (struct vrml_scene){ .source = source, .bytes_max = bytes_max / 4 * 3 };
	names_init(&ret->names, bytes_max / 4);
	r = scene_add_node(ret, VRML_GROUP, &ret->root, why);
	return r < 0 ? r : take_content(ret, ret->root, 0, why);
}
