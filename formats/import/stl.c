/* SPDX-License-Identifier: MIT */
/*
 * STL: triangles with nothing shared.  Source: 3D Systems, "StereoLithography Interface
 * Specification", 1988.  The facets' normals are not read: they are often zero or wrong, and follow
 * from the corners.  Colours: VisCAM's, and Materialise's where the header has "COLOR=".
 */
#include <ctype.h>
#include <errno.h>
#include <string.h>
#include <strings.h>

#include "formats/base/bytes.h"
#include "formats/import/job.h"

#define HEADER_BYTES 84u
#define FACET_BYTES  50u
/* How far a text is looked at before it is believed to be one. */
#define TEXT_PROBE_BYTES 1024u
#define NAME_BYTES       256u

/* The 16 bits behind a facet, if they are a colour: 5 bits each, one that says who means what. */
#define ATTRIBUTE_FLAG 0x8000u

struct stl {
	struct import_job *job;
	struct source *source;
	struct batcher batcher;
	uint32_t part;
	bool materialise;
	bool coloured; /* a facet had a colour: from then on all have */
	uint32_t colour;
};

static uint32_t load32(const uint8_t *bytes)
{
	uint32_t value;

	memcpy(&value, bytes, sizeof(value));
	return value;
}

/*
 * Is it the text form?  Both may begin with "solid": a binary file has exactly the length that its
 * count says, and bytes that no text has.
 */
static bool is_text(struct source *source)
{
	size_t seen_bytes = (size_t)(source->end - source->at);
	const uint8_t *at = source->at;

	while (seen_bytes > 0 && source_is_blank(*at)) {
		at++;
		seen_bytes--;
	}
	if (seen_bytes < 5 || strncasecmp((const char *)at, "solid", 5) != 0)
		return false;
	if (source_is_plain(source) && source->file_bytes >= HEADER_BYTES &&
	    source->file_bytes ==
		    HEADER_BYTES + (uint64_t)FACET_BYTES * load32(source->at + HEADER_BYTES - 4))
		return false;
	for (size_t i = 0; i < seen_bytes && i < TEXT_PROBE_BYTES; i++)
		if (at[i] < ' ' && !source_is_blank(at[i]))
			return false;
	return true;
}

/* ---- binary ---- */

static uint32_t colour_of_5_bits(uint32_t red, uint32_t green, uint32_t blue)
{
	return UINT32_C(0xff000000) | (blue & 31) * 255 / 31 << 16 | (green & 31) * 255 / 31 << 8 |
	       (red & 31) * 255 / 31;
}

/* Materialise: "COLOR=" and four bytes somewhere in the header's 80. */
static void find_materialise_colour(struct stl *stl, const uint8_t *header)
{
	const uint8_t *found = memmem(header, 80, "COLOR=", 6);

	if (!found || found - header > 70)
		return;
	stl->materialise = true;
	stl->colour = load32(found + 6);
}

static uint32_t facet_colour(const struct stl *stl, uint32_t attribute)
{
	if (stl->materialise)
		return attribute & ATTRIBUTE_FLAG
			       ? stl->colour
			       : colour_of_5_bits(attribute, attribute >> 5, attribute >> 10);
	return attribute & ATTRIBUTE_FLAG
		       ? colour_of_5_bits(attribute >> 10, attribute >> 5, attribute)
		       : stl->colour;
}

static int take_facet(struct stl *stl, const uint8_t *facet, bool colours, struct why *why)
{
	struct batch_kind kind = { .part = stl->part };
	uint32_t attribute = (uint32_t)facet[48] | (uint32_t)facet[49] << 8;
	uint32_t index;
	int r;

	if (colours && (stl->materialise || (attribute & ATTRIBUTE_FLAG)))
		stl->coloured = true;
	kind.colours = stl->coloured;
	r = batcher_next(&stl->batcher, &kind, &index, why);
	if (r < 0)
		return r;
	memcpy(stl->batcher.positions32 + 9 * (size_t)index, facet + 12, 36);
	if (kind.colours)
		for (size_t k = 0; k < 3; k++)
			stl->batcher.colours[3 * (size_t)index + k] = facet_colour(stl, attribute);
	stl->job->info->face_count++;
	return 0;
}

static int take_binary(struct stl *stl, struct why *why)
{
	struct source *source = stl->source;
	struct import_part part = { .name = "" };
	bool colours = batcher_wants_colours(&stl->batcher);
	uint64_t count;
	int r = source_need(source, HEADER_BYTES, why);

	if (r < 0)
		return r;
	if (colours)
		find_materialise_colour(stl, source->at);
	part.colour = stl->colour;
	count = load32(source->at + HEADER_BYTES - 4);
	source->at += HEADER_BYTES;
	if (count > source_rest_max(source) / FACET_BYTES)
		return why_set(why, -ENODATA,
			       "it claims %llu triangles, but not so many can follow",
			       (unsigned long long)count);
	r = batcher_part(&stl->batcher, &part, &stl->part, why);
	while (count > 0 && r == 0) {
		uint64_t visible;

		r = source_need(source, FACET_BYTES, why);
		if (r < 0)
			return r;
		visible = u64_min((uint64_t)(source->end - source->at) / FACET_BYTES, count);
		for (uint64_t i = 0; i < visible && r == 0; i++, source->at += FACET_BYTES)
			r = take_facet(stl, source->at, colours, why);
		count -= visible;
	}
	return r;
}

/* ---- text ---- */

/* The word at source->at in lower case, taken; "" for what is longer than any keyword. */
static int take_word(struct source *source, char word[16], struct why *why)
{
	size_t length = 0;
	int r = source_blanks(source, why);

	if (r <= 0)
		return r;
	while (source->at[length] > ' ' || source->at + length == source->end) {
		if (source->at + length < source->end) {
			length++;
			continue;
		}
		r = source_more(source, why);
		if (r < 0)
			return r;
		if (r == 0)
			break;
	}
	word[0] = '\0';
	if (length < 16) {
		for (size_t i = 0; i < length; i++)
			word[i] = (char)tolower(source->at[i]);
		word[length] = '\0';
	}
	/* A control character is no word and must be passed all the same. */
	source->at += length > 0 ? length : 1;
	return 1;
}

/* "solid NAME": begins a part.  The rest of the line is the name. */
static int take_solid(struct stl *stl, struct why *why)
{
	struct import_part part = { .colour = IMPORT_COLOUR_DEFAULT };
	char name[NAME_BYTES];
	const char *line = "";
	size_t length = 0;
	int r = source_line(stl->source, &line, &length, why);

	if (r < 0)
		return r;
	while (length > 0 && source_is_blank((uint8_t)*line)) {
		line++;
		length--;
	}
	while (length > 0 && source_is_blank((uint8_t)line[length - 1]))
		length--;
	if (length >= sizeof(name))
		length = sizeof(name) - 1;
	memcpy(name, line, length);
	name[length] = '\0';
	part.name = name;
	return batcher_part(&stl->batcher, &part, &stl->part, why);
}

static int text_fault(const struct stl *stl, struct why *why, const char *what)
{
	return why_set(why, -EUCLEAN, "line %llu: %s", (unsigned long long)stl->source->line + 1,
		       what);
}

/* "facet normal X Y Z outer loop vertex X Y Z (three times) endloop endfacet", behind "facet". */
static int take_text_facet(struct stl *stl, struct why *why)
{
	struct batch_kind kind = { .part = stl->part };
	float corners[9];
	unsigned corner_count = 0;
	uint32_t index;
	int r;

	for (;;) {
		char word[16];

		r = take_word(stl->source, word, why);
		if (r < 0)
			return r;
		if (r == 0)
			return why_set(why, -ENODATA, "line %llu: it ends within a facet",
				       (unsigned long long)stl->source->line + 1);
		if (strcmp(word, "endfacet") == 0)
			break;
		if (strcmp(word, "facet") == 0 || strcmp(word, "endsolid") == 0)
			return text_fault(stl, why, "a facet without its end");
		if (strcmp(word, "vertex") != 0)
			continue; /* "outer", "loop", the normal's numbers */
		if (corner_count == 3)
			return text_fault(stl, why, "a facet of more than three corners");
		for (unsigned k = 0; k < 3; k++) {
			r = source_float(stl->source, &corners[3 * corner_count + k], why);
			if (r < 0)
				return r;
		}
		corner_count++;
	}
	stl->job->info->face_count++;
	if (corner_count < 3) {
		stl->job->info->dropped_faces++;
		return 0;
	}
	r = batcher_next(&stl->batcher, &kind, &index, why);
	if (r == 0)
		memcpy(stl->batcher.positions32 + 9 * (size_t)index, corners, sizeof(corners));
	return r;
}

static int take_text(struct stl *stl, struct why *why)
{
	bool in_solid = false;

	for (;;) {
		char word[16];
		int r = take_word(stl->source, word, why);

		if (r < 0)
			return r;
		if (r == 0)
			break;
		if (strcmp(word, "solid") == 0) {
			r = take_solid(stl, why);
			in_solid = true;
		} else if (strcmp(word, "facet") == 0 && in_solid) {
			r = take_text_facet(stl, why);
		} else if (strcmp(word, "endsolid") == 0) {
			const char *line;
			size_t length;

			r = source_line(stl->source, &line, &length, why);
			r = r < 0 ? r : 0;
			in_solid = false;
		} else {
			r = text_fault(stl, why, "\"facet\" or \"endsolid\" is wanted");
		}
		if (r < 0)
			return r;
	}
	if (in_solid)
		return why_set(why, -ENODATA, "it ends without \"endsolid\"");
	return 0;
}

int stl_import(struct import_job *job, struct why *why)
{
	struct stl stl = {
		.job = job,
		.source = job->source,
		.colour = IMPORT_COLOUR_DEFAULT,
	};
	int r = source_need(job->source, 1, why);

	if (r < 0)
		return r;
	r = batcher_init(&stl.batcher, false, job->options, job->sink, job->info, why);
	if (r < 0)
		return r;
	/* What is longer than the window is seen by its beginning. */
	(void)source_need(job->source, HEADER_BYTES, NULL);
	r = is_text(job->source) ? take_text(&stl, why) : take_binary(&stl, why);
	if (r == 0)
		r = batcher_flush(&stl.batcher, why);
	batcher_done(&stl.batcher);
	return r;
}
