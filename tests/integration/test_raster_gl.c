/* SPDX-License-Identifier: MIT */
/*
 * Goal: the software rasteriser and OpenGL give the same picture of items.
 * Method: random scenes through both, with the one transform of camera.h; an EGL context without a
 * surface.  Where the GL is llvmpipe the pictures must agree to 2 pixels in 10^5, elsewhere the
 * test says what it found.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <epoxy/egl.h>
#include <epoxy/gl.h>

#include "formats/base/bytes.h"
#include "formats/base/random.h"
#include "libclient/select/raster.h"

#define WIDTH  640
#define HEIGHT 479 /* odd, so that a picture upside down does not pass */

static const char vertex_source[] =
	"#version 450 core\n"
	"layout(location = 0) in vec3 position;\n"
	"uniform float scale;\n"
	"uniform vec3 offset;\n"
	"uniform vec4 rows[4];\n"
	"void main()\n"
	"{\n"
	"	precise vec3 p = scale * position + offset;\n"
	"	precise vec4 clip;\n"
	"	for (int i = 0; i < 4; i++)\n"
	"		clip[i] = ((rows[i].x * p.x + rows[i].y * p.y) + rows[i].z * p.z) +\n"
	"			  rows[i].w;\n"
	"	gl_Position = clip;\n"
	"}\n";

static const char fragment_source[] = "#version 450 core\n"
				      "layout(location = 0) out uint item;\n"
				      "void main()\n"
				      "{\n"
				      "	item = uint(gl_PrimitiveID);\n"
				      "}\n";

static struct random dice;

/* GL drivers leak, and are gone when LeakSanitizer looks, so that it cannot name them. */
int __lsan_is_turned_off(void);
int __lsan_is_turned_off(void)
{
	return 1;
}

/* ---- GL ---- */

static EGLDisplay display;
static EGLContext context;
static GLuint program;

static GLuint shader_compile(GLenum type, const char *source)
{
	GLuint shader = glCreateShader(type);
	GLint compiled;

	glShaderSource(shader, 1, &source, NULL);
	glCompileShader(shader);
	glGetShaderiv(shader, GL_COMPILE_STATUS, &compiled);
	assert_true(compiled);
	return shader;
}

static int gl_setup(void **state)
{
	static const EGLint attributes[] = { EGL_CONTEXT_MAJOR_VERSION,
					     4,
					     EGL_CONTEXT_MINOR_VERSION,
					     5,
					     EGL_CONTEXT_OPENGL_PROFILE_MASK,
					     EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT,
					     EGL_NONE };
	GLuint target;
	GLuint colour;
	GLuint depth;

	(void)state;
	display = eglGetPlatformDisplayEXT(EGL_PLATFORM_SURFACELESS_MESA, NULL, NULL);
	if (!eglInitialize(display, NULL, NULL) || !eglBindAPI(EGL_OPENGL_API))
		return -1;
	context = eglCreateContext(display, EGL_NO_CONFIG_KHR, EGL_NO_CONTEXT, attributes);
	if (!context || !eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, context))
		return -1;

	program = glCreateProgram();
	glAttachShader(program, shader_compile(GL_VERTEX_SHADER, vertex_source));
	glAttachShader(program, shader_compile(GL_FRAGMENT_SHADER, fragment_source));
	glLinkProgram(program);
	glUseProgram(program);

	glCreateFramebuffers(1, &target);
	glCreateTextures(GL_TEXTURE_2D, 1, &colour);
	glCreateTextures(GL_TEXTURE_2D, 1, &depth);
	glTextureStorage2D(colour, 1, GL_R32UI, WIDTH, HEIGHT);
	glTextureStorage2D(depth, 1, GL_DEPTH_COMPONENT32F, WIDTH, HEIGHT);
	glNamedFramebufferTexture(target, GL_COLOR_ATTACHMENT0, colour, 0);
	glNamedFramebufferTexture(target, GL_DEPTH_ATTACHMENT, depth, 0);
	glBindFramebuffer(GL_FRAMEBUFFER, target);
	glViewport(0, 0, WIDTH, HEIGHT);
	glClipControl(GL_LOWER_LEFT, GL_ZERO_TO_ONE);
	glEnable(GL_DEPTH_TEST);
	glDepthFunc(GL_GREATER);
	glPolygonOffset(RASTER_DEPTH_OFFSET, 0.0f);
	glEnable(GL_POLYGON_OFFSET_FILL);
	return glGetError() == GL_NO_ERROR ? 0 : -1;
}

static int gl_teardown(void **state)
{
	(void)state;
	eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
	eglDestroyContext(display, context);
	eglTerminate(display);
	return 0;
}

static void gl_draw(const struct camera_view *view, const struct raster_draw *draw,
		    uint32_t *ret_items, float *ret_depths)
{
	static const GLuint no_item[4] = { UINT32_MAX, UINT32_MAX, UINT32_MAX, UINT32_MAX };
	static const GLfloat infinitely_far = 0.0f;
	GLuint buffers[2];
	GLuint array;

	glCreateVertexArrays(1, &array);
	glBindVertexArray(array);
	glGenBuffers(2, buffers);
	glBindBuffer(GL_ARRAY_BUFFER, buffers[0]);
	glBufferData(GL_ARRAY_BUFFER, (GLsizeiptr)draw->vertex_count * 12, draw->positions,
		     GL_STATIC_DRAW);
	glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, buffers[1]);
	glBufferData(GL_ELEMENT_ARRAY_BUFFER, (GLsizeiptr)draw->triangle_count * 12, draw->indices,
		     GL_STATIC_DRAW);
	glVertexAttribPointer(0, 3, GL_FLOAT, GL_FALSE, 12, NULL);
	glEnableVertexAttribArray(0);
	glUniform1f(glGetUniformLocation(program, "scale"), draw->scale);
	glUniform3fv(glGetUniformLocation(program, "offset"), 1, draw->offset);
	glUniform4fv(glGetUniformLocation(program, "rows"), 4, &view->view_projection[0][0]);
	glClearBufferuiv(GL_COLOR, 0, no_item);
	glClearBufferfv(GL_DEPTH, 0, &infinitely_far);
	glDrawElements(GL_TRIANGLES, (GLsizei)draw->triangle_count * 3, GL_UNSIGNED_INT, NULL);
	glReadPixels(0, 0, WIDTH, HEIGHT, GL_RED_INTEGER, GL_UNSIGNED_INT, ret_items);
	glReadPixels(0, 0, WIDTH, HEIGHT, GL_DEPTH_COMPONENT, GL_FLOAT, ret_depths);
	assert_int_equal(glGetError(), GL_NO_ERROR);
	glDeleteBuffers(2, buffers);
	glDeleteVertexArrays(1, &array);
}

/* ---- the comparison ---- */

struct difference {
	uint64_t covered;
	uint64_t items;  /* pixels with another item */
	uint64_t depths; /* pixels with the same item and another depth */
};

static void compare(const struct camera *camera, const struct raster_draw *draw,
		    struct difference *sum)
{
	static uint32_t items[WIDTH * HEIGHT];
	static float depths[WIDTH * HEIGHT];
	struct store_superblock superblock = { .step_exponent = -10 };
	struct camera_view view;
	struct raster_draw moved = *draw;
	struct raster *raster;
	static const double origin[3];

	assert_int_equal(camera_view_init(&view, camera, &superblock, (double)WIDTH / HEIGHT, 0.05),
			 0);
	camera_node_offset(&view, origin, moved.offset);
	gl_draw(&view, &moved, items, depths);
	assert_int_equal(raster_create(WIDTH, HEIGHT, &raster), 0);
	assert_int_equal(raster_triangles(raster, &view, &moved), 0);
	for (uint32_t y = 0; y < HEIGHT; y++) {
		for (uint32_t x = 0; x < WIDTH; x++) {
			size_t ours = (size_t)y * WIDTH + x;
			size_t theirs = (size_t)(HEIGHT - 1 - y) * WIDTH + x;
			uint64_t item =
				items[theirs] == UINT32_MAX ? RASTER_ITEM_NONE : items[theirs];

			sum->covered += raster_items(raster)[ours] != RASTER_ITEM_NONE;
			sum->items += raster_items(raster)[ours] != item;
			sum->depths += raster_items(raster)[ours] == item &&
				       raster_depths(raster)[ours] != depths[theirs];
		}
	}
	raster_destroy(raster);
}

/* Triangles of a size in a cube of edge 20 about the origin, on a grid of 2^-10. */
static void soup_make(struct raster_draw *draw, uint32_t triangle_count, double size)
{
	uint32_t vertex_count = 3 * triangle_count;
	float *positions = malloc(vertex_count * 3 * sizeof(*positions));
	uint32_t *indices = malloc(vertex_count * sizeof(*indices));

	assert_non_null(positions);
	assert_non_null(indices);
	for (uint32_t i = 0; i < triangle_count; i++) {
		double centre[3];

		for (int k = 0; k < 3; k++)
			centre[k] = 20.0 * (random_unit(&dice) - 0.5);
		for (uint32_t corner = 0; corner < 3; corner++)
			for (uint32_t k = 0; k < 3; k++)
				positions[9 * i + 3 * corner + k] = rintf(
					(float)((centre[k] + size * (random_unit(&dice) - 0.5)) *
						1024));
	}
	for (uint32_t i = 0; i < vertex_count; i++)
		indices[i] = i;
	*draw = (struct raster_draw){ .positions = positions,
				      .vertex_count = vertex_count,
				      .indices = indices,
				      .triangle_count = triangle_count,
				      .scale = 0x1p-10f };
}

static void draw_done(struct raster_draw *draw)
{
	free((void *)(uintptr_t)draw->positions);
	free((void *)(uintptr_t)draw->indices);
}

static void scenes_agree(const char *name, uint32_t triangle_count, double size, bool inside)
{
	struct difference sum = { 0 };
	bool is_llvmpipe = strstr((const char *)glGetString(GL_RENDERER), "llvmpipe") != NULL;

	for (unsigned seed = 0; seed < 8; seed++) {
		struct camera camera = { .up = { 0, 0, 1 }, .fov_y_degrees = 60 };
		struct raster_draw draw;

		dice.state = seed * 1000;
		soup_make(&draw, triangle_count, size);
		for (int k = 0; k < 3; k++) {
			camera.eye[k] = (inside ? 8.0 : 40.0) * (random_unit(&dice) - 0.5);
			camera.at[k] = 2.0 * random_unit(&dice);
		}
		compare(&camera, &draw, &sum);
		draw_done(&draw);
	}
	print_message("%s: %llu of %llu covered pixels have another item, %llu another depth\n",
		      name, (unsigned long long)sum.items, (unsigned long long)sum.covered,
		      (unsigned long long)sum.depths);
	if (is_llvmpipe)
		assert_true(sum.items * 100000 <= sum.covered * 2);
}

static void raster_agrees_with_gl_on_small_triangles(void **state)
{
	(void)state;
	scenes_agree("small triangles", 200000, 0.1, false);
}

static void raster_agrees_with_gl_on_large_triangles(void **state)
{
	(void)state;
	scenes_agree("large triangles", 2000, 5.0, false);
}

static void raster_agrees_with_gl_where_triangles_are_clipped(void **state)
{
	(void)state;
	scenes_agree("clipped triangles", 3000, 8.0, true);
}

int main(void)
{
	static const struct CMUnitTest tests[] = {
		cmocka_unit_test(raster_agrees_with_gl_on_small_triangles),
		cmocka_unit_test(raster_agrees_with_gl_on_large_triangles),
		cmocka_unit_test(raster_agrees_with_gl_where_triangles_are_clipped),
	};

	return cmocka_run_group_tests_name("raster_gl", tests, gl_setup, gl_teardown);
}
