/* SPDX-License-Identifier: MIT */
#include "viewer/box_test.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <epoxy/gl.h>

#include "formats/base/clock.h"
#include "viewer/shader.h"

/* Locations in shaders/box.vert. */
enum location {
	LOCATION_CLIP_ROWS = 0,
	LOCATION_TILE = 4,
	LOCATION_FIRST_BOX = 5,
};

enum storage_block {
	STORAGE_BOXES = 0,
	STORAGE_SHOWS = 1,
};

#define CORNER_COUNT 36

/* Pixels by which a box is larger: corners are snapped to a fraction of one, 1/16 at most in GL. */
#define MARGIN_PIXELS 0.25

struct box_record {
	float box_min[4];
	float box_max[4];
};

struct box_test {
	GLuint flag_program;
	GLuint query_program;
	GLuint array; /* without attributes */
	GLuint boxes_buffer;
	GLuint shows_buffer;
	GLuint *queries;
	size_t query_count;

	/* Of the boxes of a test that are drawn. */
	struct box_record *records;
	size_t *numbers; /* which box each is */
	uint32_t *shows;
	size_t room;
};

int box_test_create(struct box_test **ret, struct why *why)
{
	struct box_test *test = calloc(1, sizeof(*test));
	int r;

	if (!test)
		return why_errno(why, -ENOMEM, "the test of boxes");
	r = shader_program_create(shader_text_box_vert, "", shader_text_box_flag_frag,
				  &test->flag_program, why);
	if (r == 0)
		r = shader_program_create(shader_text_box_vert, "", shader_text_box_query_frag,
					  &test->query_program, why);
	if (r < 0) {
		box_test_destroy(test);
		return r;
	}
	glCreateVertexArrays(1, &test->array);
	glCreateBuffers(1, &test->boxes_buffer);
	glCreateBuffers(1, &test->shows_buffer);
	*ret = test;
	return 0;
}

struct box_test *box_test_destroy(struct box_test *test)
{
	if (!test)
		return NULL;
	glDeleteQueries((GLsizei)test->query_count, test->queries);
	glDeleteBuffers(1, &test->boxes_buffer);
	glDeleteBuffers(1, &test->shows_buffer);
	glDeleteVertexArrays(1, &test->array);
	glDeleteProgram(test->flag_program);
	glDeleteProgram(test->query_program);
	free(test->queries);
	free(test->records);
	free(test->numbers);
	free(test->shows);
	free(test);
	return NULL;
}

static int reserve(struct box_test *test, size_t count)
{
	size_t room = count + count / 2;
	void *grown;

	if (count <= test->room)
		return 0;
	grown = reallocarray(test->records, room, sizeof(*test->records));
	if (!grown)
		return -ENOMEM;
	test->records = grown;
	grown = reallocarray(test->numbers, room, sizeof(*test->numbers));
	if (!grown)
		return -ENOMEM;
	test->numbers = grown;
	grown = reallocarray(test->shows, room, sizeof(*test->shows));
	if (!grown)
		return -ENOMEM;
	test->shows = grown;
	test->room = room;
	return 0;
}

/* Makes the record of a box, larger.  Returns: false when the eye is in it. */
static bool enlarge(const struct box_test_view *view, const struct conservative_box *box,
		    struct box_record *ret)
{
	const struct camera_view *camera = view->view;
	double across = 2.0 * camera->tan_half_x / (view->width * (double)view->tile->scale_x);
	double down = 2.0 * camera->tan_half_y / (view->height * (double)view->tile->scale_y);
	double farthest2 = 0.0;
	bool is_outside = false;
	double margin;

	for (int k = 0; k < 3; k++) {
		double low = box->box_min[k] - camera->eye[k];
		double high = box->box_max[k] - camera->eye[k];

		farthest2 += fmax(low * low, high * high);
	}
	margin = MARGIN_PIXELS * fmax(across, down) * sqrt(farthest2);
	memset(ret, 0, sizeof(*ret));
	for (int k = 0; k < 3; k++) {
		double low = box->box_min[k] - margin;
		double high = box->box_max[k] + margin;

		is_outside = is_outside || low > camera->eye[k] || high < camera->eye[k];
		ret->box_min[k] = (float)(low - camera->anchor[k]);
		ret->box_max[k] = (float)(high - camera->anchor[k]);
	}
	return is_outside;
}

/* Takes those that the eye is not in; the others show.  Returns: how many, or -ENOMEM. */
static int take_boxes(struct box_test *test, const struct box_test_view *view,
		      const struct conservative_box *boxes, size_t box_count, bool *ret_shows,
		      size_t *ret_count)
{
	size_t count = 0;

	if (reserve(test, box_count) < 0)
		return -ENOMEM;
	for (size_t i = 0; i < box_count; i++) {
		ret_shows[i] = !enlarge(view, &boxes[i], &test->records[count]);
		if (!ret_shows[i])
			test->numbers[count++] = i;
	}
	*ret_count = count;
	if (count == 0)
		return 0;
	while (glGetError() != GL_NO_ERROR)
		;
	glNamedBufferData(test->boxes_buffer, (GLsizeiptr)(count * sizeof(*test->records)),
			  test->records, GL_STREAM_DRAW);
	return glGetError() == GL_NO_ERROR ? 0 : -ENOMEM;
}

/* Nothing is written, what is as near as a surface passes, and only the sides towards the eye count. */
static void begin_drawing(struct box_test *test, GLuint program, const struct box_test_view *view)
{
	glUseProgram(program);
	glBindVertexArray(test->array);
	glBindBufferBase(GL_SHADER_STORAGE_BUFFER, STORAGE_BOXES, test->boxes_buffer);
	glUniform4fv(LOCATION_CLIP_ROWS, 4, &view->view->view_projection[0][0]);
	glUniform4f(LOCATION_TILE, view->tile->scale_x, view->tile->scale_y, view->tile->shift_x,
		    view->tile->shift_y);
	glUniform1ui(LOCATION_FIRST_BOX, 0);
	glDepthFunc(GL_GEQUAL);
	glDepthMask(GL_FALSE);
	glColorMask(GL_FALSE, GL_FALSE, GL_FALSE, GL_FALSE);
	glEnable(GL_CULL_FACE);
	glDisable(GL_POLYGON_OFFSET_FILL); /* it would hide them */
	/*
	 * Every ray from the eye enters a box that the eye is not in through a side towards the eye,
	 * and that side may lie before the near plane: it is drawn there, as near as can be.
	 */
	glEnable(GL_DEPTH_CLAMP);
}

static void end_drawing(void)
{
	glDisable(GL_DEPTH_CLAMP);
	glDisable(GL_CULL_FACE);
	glEnable(GL_POLYGON_OFFSET_FILL);
	glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
	glDepthMask(GL_TRUE);
	glDepthFunc(GL_GREATER);
}

int box_test_flags(struct box_test *test, const struct box_test_view *view,
		   const struct conservative_box *boxes, size_t box_count, bool *ret_shows)
{
	const GLuint zero = 0;
	size_t count;
	int r = take_boxes(test, view, boxes, box_count, ret_shows, &count);

	if (r < 0 || count == 0)
		return r;
	glNamedBufferData(test->shows_buffer, (GLsizeiptr)(count * sizeof(*test->shows)), NULL,
			  GL_STREAM_READ);
	if (glGetError() != GL_NO_ERROR)
		return -ENOMEM;
	glClearNamedBufferData(test->shows_buffer, GL_R32UI, GL_RED_INTEGER, GL_UNSIGNED_INT,
			       &zero);
	begin_drawing(test, test->flag_program, view);
	glBindBufferBase(GL_SHADER_STORAGE_BUFFER, STORAGE_SHOWS, test->shows_buffer);
	glDrawArraysInstanced(GL_TRIANGLES, 0, CORNER_COUNT, (GLsizei)count);
	end_drawing();
	glMemoryBarrier(GL_BUFFER_UPDATE_BARRIER_BIT);
	glGetNamedBufferSubData(test->shows_buffer, 0, (GLsizeiptr)(count * sizeof(*test->shows)),
				test->shows);
	for (size_t i = 0; i < count; i++)
		ret_shows[test->numbers[i]] = test->shows[i] != 0;
	return 0;
}

static int reserve_queries(struct box_test *test, size_t count)
{
	GLuint *queries;

	if (count <= test->query_count)
		return 0;
	queries = reallocarray(test->queries, count, sizeof(*queries));
	if (!queries)
		return -ENOMEM;
	test->queries = queries;
	glGenQueries((GLsizei)(count - test->query_count), queries + test->query_count);
	test->query_count = count;
	return 0;
}

static void wait_until(uint64_t time_ns)
{
	uint64_t now_ns = clock_now_ns();

	while (now_ns < time_ns) {
		clock_pause_ns(time_ns - now_ns);
		now_ns = clock_now_ns();
	}
}

int box_test_queries(struct box_test *test, const struct box_test_view *view,
		     const struct conservative_box *boxes, size_t box_count, uint64_t latency_ns,
		     bool *ret_shows)
{
	size_t count;
	int r = take_boxes(test, view, boxes, box_count, ret_shows, &count);

	if (r == 0)
		r = reserve_queries(test, count);
	if (r < 0 || count == 0)
		return r;
	begin_drawing(test, test->query_program, view);
	for (size_t i = 0; i < count; i++) {
		glUniform1ui(LOCATION_FIRST_BOX, (GLuint)i);
		glBeginQuery(GL_ANY_SAMPLES_PASSED, test->queries[i]);
		glDrawArrays(GL_TRIANGLES, 0, CORNER_COUNT);
		glEndQuery(GL_ANY_SAMPLES_PASSED);
	}
	end_drawing();
	glFlush();
	if (latency_ns > 0)
		wait_until(clock_now_ns() + latency_ns);
	for (size_t i = 0; i < count; i++) {
		GLuint passed = 1;

		glGetQueryObjectuiv(test->queries[i], GL_QUERY_RESULT, &passed);
		ret_shows[test->numbers[i]] = passed != 0;
	}
	return 0;
}
