/* SPDX-License-Identifier: MIT */
#include "viewer/target.h"

#include <errno.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/check.h"

uint32_t target_side_max(void)
{
	GLint side = 0;
	GLint viewport_max[2] = { 0, 0 };

	glGetIntegerv(GL_MAX_RENDERBUFFER_SIZE, &side);
	glGetIntegerv(GL_MAX_VIEWPORT_DIMS, viewport_max);
	if (side > viewport_max[0])
		side = viewport_max[0];
	if (side > viewport_max[1])
		side = viewport_max[1];
	return (uint32_t)side;
}

static GLenum pixel_format(enum channel channel)
{
	switch (channel) {
	case CHANNEL_COLOUR:
	case CHANNEL_DEPTH:
		return GL_RGBA8;
	case CHANNEL_PART:
	case CHANNEL_NODE:
	case CHANNEL_TRIANGLE:
		return GL_RG32UI;
	case CHANNEL_NORMAL:
		return GL_RGBA32F;
	case CHANNEL_COUNT_:
		break;
	}
	CHECK(!"a channel");
	return GL_NONE;
}

int target_init(struct target *ret, uint32_t width, uint32_t height, enum channel channel,
		struct why *why)
{
	struct target target = { .width = width, .height = height, .channel = channel };

	CHECK(width > 0 && height > 0);
	while (glGetError() != GL_NO_ERROR)
		;
	glCreateRenderbuffers(1, &target.pixels);
	glCreateRenderbuffers(1, &target.depth);
	glCreateFramebuffers(1, &target.framebuffer);
	glNamedRenderbufferStorage(target.pixels, pixel_format(channel), (GLsizei)width,
				   (GLsizei)height);
	glNamedRenderbufferStorage(target.depth, GL_DEPTH_COMPONENT32F, (GLsizei)width,
				   (GLsizei)height);
	glNamedFramebufferRenderbuffer(target.framebuffer, GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER,
				       target.pixels);
	glNamedFramebufferRenderbuffer(target.framebuffer, GL_DEPTH_ATTACHMENT, GL_RENDERBUFFER,
				       target.depth);
	if (glGetError() != GL_NO_ERROR ||
	    glCheckNamedFramebufferStatus(target.framebuffer, GL_FRAMEBUFFER) !=
		    GL_FRAMEBUFFER_COMPLETE) {
		target_done(&target);
		return why_set(why, -ENOMEM, "OpenGL has no room for a picture of %ux%u", width,
			       height);
	}
	*ret = target;
	return 0;
}

void target_done(struct target *target)
{
	glDeleteFramebuffers(1, &target->framebuffer);
	glDeleteRenderbuffers(1, &target->pixels);
	glDeleteRenderbuffers(1, &target->depth);
	memset(target, 0, sizeof(*target));
}

void target_begin(const struct target *target, const uint8_t background[3])
{
	const GLuint no_item[4] = { UINT32_MAX, UINT32_MAX, 0, 0 };
	const GLfloat no_normal[4] = { 0.0f, 0.0f, 0.0f, 0.0f };
	const GLfloat colour[4] = { (float)background[0] / 255.0f, (float)background[1] / 255.0f,
				    (float)background[2] / 255.0f, 1.0f };
	const GLfloat far = 0.0f;

	glBindFramebuffer(GL_FRAMEBUFFER, target->framebuffer);
	glViewport(0, 0, (GLsizei)target->width, (GLsizei)target->height);
	glEnable(GL_DEPTH_TEST);
	switch (target->channel) {
	case CHANNEL_COLOUR:
	case CHANNEL_DEPTH:
		glClearBufferfv(GL_COLOR, 0, colour);
		break;
	case CHANNEL_PART:
	case CHANNEL_NODE:
	case CHANNEL_TRIANGLE:
		glClearBufferuiv(GL_COLOR, 0, no_item);
		break;
	case CHANNEL_NORMAL:
		glClearBufferfv(GL_COLOR, 0, no_normal);
		break;
	case CHANNEL_COUNT_:
		break;
	}
	glClearBufferfv(GL_DEPTH, 0, &far);
}

/* GL's rows begin at the bottom. */
static void turn_over(uint8_t *pixels, size_t row_bytes, uint32_t height)
{
	for (uint32_t y = 0; y < height / 2; y++) {
		uint8_t *a = pixels + y * row_bytes;
		uint8_t *b = pixels + (height - 1 - y) * row_bytes;

		for (size_t i = 0; i < row_bytes; i++) {
			uint8_t byte = a[i];

			a[i] = b[i];
			b[i] = byte;
		}
	}
}

void target_read(const struct target *target, void *ret)
{
	GLenum format = GL_RGBA;
	GLenum type = GL_UNSIGNED_BYTE;

	switch (target->channel) {
	case CHANNEL_COLOUR:
	case CHANNEL_COUNT_:
		break;
	case CHANNEL_PART:
	case CHANNEL_NODE:
	case CHANNEL_TRIANGLE:
		format = GL_RG_INTEGER;
		type = GL_UNSIGNED_INT;
		break;
	case CHANNEL_DEPTH:
		format = GL_DEPTH_COMPONENT;
		type = GL_FLOAT;
		break;
	case CHANNEL_NORMAL:
		format = GL_RGB;
		type = GL_FLOAT;
		break;
	}
	glBindFramebuffer(GL_READ_FRAMEBUFFER, target->framebuffer);
	glReadPixels(0, 0, (GLsizei)target->width, (GLsizei)target->height, format, type, ret);
	turn_over(ret, target->width * channel_pixel_bytes(target->channel), target->height);
}

static bool is_inside(const struct target *target, int x, int y)
{
	return x >= 0 && y >= 0 && (uint32_t)x < target->width && (uint32_t)y < target->height;
}

float target_read_depth(const struct target *target, int x, int y)
{
	float depth = 0.0f;

	if (!is_inside(target, x, y))
		return 0.0f;
	glBindFramebuffer(GL_READ_FRAMEBUFFER, target->framebuffer);
	glReadPixels(x, (GLint)target->height - 1 - y, 1, 1, GL_DEPTH_COMPONENT, GL_FLOAT, &depth);
	return depth;
}

uint64_t target_read_item(const struct target *target, int x, int y)
{
	uint64_t item = CHANNEL_ITEM_NONE;

	if (!is_inside(target, x, y))
		return CHANNEL_ITEM_NONE;
	glBindFramebuffer(GL_READ_FRAMEBUFFER, target->framebuffer);
	glReadPixels(x, (GLint)target->height - 1 - y, 1, 1, GL_RG_INTEGER, GL_UNSIGNED_INT, &item);
	return item;
}
