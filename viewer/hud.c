/* SPDX-License-Identifier: MIT */
#include "viewer/hud.h"

#include <errno.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include <epoxy/gl.h>

#include "viewer/font.h"
#include "viewer/shader.h"

#define BLOCK_COUNT_MAX 4
#define BLOCK_BYTES     4096
#define CELL_COUNT_MAX  (BLOCK_COUNT_MAX * BLOCK_BYTES)
#define ROW_PIXELS      (FONT_HEIGHT + 1)

/* Locations in shaders/text.vert and text.frag. */
enum location {
	LOCATION_SCREEN = 0,
	LOCATION_GLYPH_PIXELS = 1,
	LOCATION_FONT = 2,
};

/* Glyph 0 is a panel; a character's glyph is one more than its place in the font. */
#define GLYPH_PANEL 0
#define GLYPH_COUNT (FONT_LAST - FONT_FIRST + 2)

/* One rectangle, as shaders/text.vert takes it; pixels of the window. */
struct hud_cell {
	int16_t x, y; /* of the upper left corner */
	int16_t width, height;
	uint8_t colour[4];
	int32_t glyph; /* GLYPH_PANEL, or a character's */
};

struct hud_block {
	enum hud_corner corner;
	char text[BLOCK_BYTES];
};

struct hud {
	GLuint program;
	GLuint array;
	GLuint buffer;
	GLuint font;
	size_t block_count;
	struct hud_block blocks[BLOCK_COUNT_MAX];
	size_t cell_count;
	struct hud_cell cells[CELL_COUNT_MAX];
};

static void create_font(struct hud *hud)
{
	uint8_t texels[GLYPH_COUNT][FONT_HEIGHT] = { { 0 } };

	for (int glyph = 1; glyph < GLYPH_COUNT; glyph++)
		font_glyph((unsigned char)(FONT_FIRST + glyph - 1), texels[glyph]);
	glCreateTextures(GL_TEXTURE_2D, 1, &hud->font);
	glTextureStorage2D(hud->font, 1, GL_R8UI, FONT_HEIGHT, GLYPH_COUNT);
	glTextureSubImage2D(hud->font, 0, 0, 0, FONT_HEIGHT, GLYPH_COUNT, GL_RED_INTEGER,
			    GL_UNSIGNED_BYTE, texels);
	glTextureParameteri(hud->font, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
	glTextureParameteri(hud->font, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
}

int hud_create(struct hud **ret, struct why *why)
{
	struct hud *hud = calloc(1, sizeof(*hud));
	int r;

	if (!hud)
		return why_errno(why, -ENOMEM, "the head-up display");
	r = shader_program_create(shader_text_text_vert, "", shader_text_text_frag, &hud->program,
				  why);
	if (r < 0) {
		free(hud);
		return r;
	}
	create_font(hud);
	glCreateBuffers(1, &hud->buffer);
	glNamedBufferStorage(hud->buffer, sizeof(hud->cells), NULL, GL_DYNAMIC_STORAGE_BIT);
	glCreateVertexArrays(1, &hud->array);
	glVertexArrayVertexBuffer(hud->array, 0, hud->buffer, 0, sizeof(struct hud_cell));
	glVertexArrayBindingDivisor(hud->array, 0, 1);
	glEnableVertexArrayAttrib(hud->array, 0);
	glVertexArrayAttribBinding(hud->array, 0, 0);
	glVertexArrayAttribIFormat(hud->array, 0, 4, GL_SHORT, 0);
	glEnableVertexArrayAttrib(hud->array, 1);
	glVertexArrayAttribBinding(hud->array, 1, 0);
	glVertexArrayAttribFormat(hud->array, 1, 4, GL_UNSIGNED_BYTE, GL_TRUE,
				  offsetof(struct hud_cell, colour));
	glEnableVertexArrayAttrib(hud->array, 2);
	glVertexArrayAttribBinding(hud->array, 2, 0);
	glVertexArrayAttribIFormat(hud->array, 2, 1, GL_INT, offsetof(struct hud_cell, glyph));
	*ret = hud;
	return 0;
}

struct hud *hud_destroy(struct hud *hud)
{
	if (!hud)
		return NULL;
	glDeleteProgram(hud->program);
	glDeleteTextures(1, &hud->font);
	glDeleteVertexArrays(1, &hud->array);
	glDeleteBuffers(1, &hud->buffer);
	free(hud);
	return NULL;
}

void hud_add(struct hud *hud, enum hud_corner corner, const char *text)
{
	struct hud_block *block;

	if (hud->block_count == BLOCK_COUNT_MAX)
		return;
	block = &hud->blocks[hud->block_count++];
	block->corner = corner;
	block->text[0] = '\0';
	strncat(block->text, text, sizeof(block->text) - 1);
}

/* ---- layout ---- */

static void add_cell(struct hud *hud, const struct hud_cell *cell)
{
	if (hud->cell_count < CELL_COUNT_MAX)
		hud->cells[hud->cell_count++] = *cell;
}

static void measure(const char *text, int *ret_columns, int *ret_rows)
{
	int column = 0;

	*ret_columns = 0;
	*ret_rows = 1;
	for (; *text; text++) {
		if (*text == '\n') {
			(*ret_rows)++;
			column = 0;
		} else if (++column > *ret_columns) {
			*ret_columns = column;
		}
	}
}

static int glyph_of(unsigned char character)
{
	if (character < FONT_FIRST || character > FONT_LAST)
		character = '?';
	return character - FONT_FIRST + 1;
}

static void lay_out_text(struct hud *hud, const char *text, int left, int top, int magnify)
{
	struct hud_cell cell = { .x = (int16_t)left,
				 .y = (int16_t)top,
				 .width = (int16_t)(FONT_WIDTH * magnify),
				 .height = (int16_t)(FONT_HEIGHT * magnify),
				 .colour = { 236, 238, 240, 255 } };

	for (; *text; text++) {
		if (*text == '\n') {
			cell.x = (int16_t)left;
			cell.y = (int16_t)(cell.y + ROW_PIXELS * magnify);
			continue;
		}
		cell.glyph = glyph_of((unsigned char)*text);
		if (*text != ' ')
			add_cell(hud, &cell);
		cell.x = (int16_t)(cell.x + cell.width);
	}
}

static void lay_out(struct hud *hud, const struct hud_block *block, int width, int height,
		    int magnify)
{
	const int margin = 4 * magnify;
	struct hud_cell panel = { .glyph = GLYPH_PANEL, .colour = { 16, 18, 22, 196 } };
	int columns;
	int rows;

	measure(block->text, &columns, &rows);
	panel.width = (int16_t)(columns * FONT_WIDTH * magnify + 2 * margin);
	panel.height = (int16_t)(rows * ROW_PIXELS * magnify + 2 * margin);
	panel.x = (int16_t)margin;
	panel.y = (int16_t)margin;
	if (block->corner == HUD_BOTTOM_LEFT)
		panel.y = (int16_t)(height - panel.height - margin);
	if (block->corner == HUD_CENTRE) {
		panel.x = (int16_t)((width - panel.width) / 2);
		panel.y = (int16_t)((height - panel.height) / 2);
	}
	add_cell(hud, &panel);
	lay_out_text(hud, block->text, panel.x + margin, panel.y + margin, magnify);
}

void hud_draw(struct hud *hud, uint32_t width, uint32_t height)
{
	const int magnify = width >= 900 ? 2 : 1;

	hud->cell_count = 0;
	for (size_t i = 0; i < hud->block_count; i++)
		lay_out(hud, &hud->blocks[i], (int)width, (int)height, magnify);
	hud->block_count = 0;
	if (hud->cell_count == 0)
		return;
	glNamedBufferSubData(hud->buffer, 0,
			     (GLsizeiptr)(hud->cell_count * sizeof(struct hud_cell)), hud->cells);
	glBindFramebuffer(GL_FRAMEBUFFER, 0);
	glViewport(0, 0, (GLsizei)width, (GLsizei)height);
	glDisable(GL_DEPTH_TEST);
	glEnable(GL_BLEND);
	glBlendFunc(GL_SRC_ALPHA, GL_ONE_MINUS_SRC_ALPHA);
	glUseProgram(hud->program);
	glUniform2f(LOCATION_SCREEN, (float)width, (float)height);
	glUniform2f(LOCATION_GLYPH_PIXELS, FONT_WIDTH, FONT_HEIGHT);
	glUniform1i(LOCATION_FONT, 0);
	glBindTextureUnit(0, hud->font);
	glBindVertexArray(hud->array);
	glDrawArraysInstanced(GL_TRIANGLE_STRIP, 0, 4, (GLsizei)hud->cell_count);
	glBindVertexArray(0);
	glDisable(GL_BLEND);
}
