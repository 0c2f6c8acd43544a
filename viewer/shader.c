/* SPDX-License-Identifier: MIT */
#include "viewer/shader.h"

#include <errno.h>
#include <stddef.h>
#include <string.h>

#include "formats/base/bytes.h"

static const char version_line[] = "#version 450 core\n";

/* A driver's log has many lines; the first tells. */
static int say_why(struct why *why, const char *what, char *log)
{
	log[strcspn(log, "\n")] = '\0';
	return why_set(why, -EUCLEAN, "the OpenGL driver refuses %s: %s", what, log);
}

static int compile(GLenum stage, const char *common, const char *text, GLuint *ret, struct why *why)
{
	const char *texts[] = { version_line, common, text };
	GLuint shader = glCreateShader(stage);
	char log[WHY_TEXT_BYTES] = "";
	GLint good = GL_FALSE;

	glShaderSource(shader, (GLsizei)ARRAY_LENGTH(texts), texts, NULL);
	glCompileShader(shader);
	glGetShaderiv(shader, GL_COMPILE_STATUS, &good);
	if (!good) {
		glGetShaderInfoLog(shader, sizeof(log), NULL, log);
		glDeleteShader(shader);
		return say_why(why, "a shader", log);
	}
	*ret = shader;
	return 0;
}

int shader_program_create(const char *vertex, const char *common, const char *fragment, GLuint *ret,
			  struct why *why)
{
	char log[WHY_TEXT_BYTES] = "";
	GLuint vertex_shader;
	GLuint fragment_shader;
	GLint good = GL_FALSE;
	GLuint program;
	int r;

	r = compile(GL_VERTEX_SHADER, "", vertex, &vertex_shader, why);
	if (r < 0)
		return r;
	r = compile(GL_FRAGMENT_SHADER, common, fragment, &fragment_shader, why);
	if (r < 0) {
		glDeleteShader(vertex_shader);
		return r;
	}
	program = glCreateProgram();
	glAttachShader(program, vertex_shader);
	glAttachShader(program, fragment_shader);
	glLinkProgram(program);
	/* The program keeps what it needs of them. */
	glDeleteShader(vertex_shader);
	glDeleteShader(fragment_shader);
	glGetProgramiv(program, GL_LINK_STATUS, &good);
	if (!good) {
		glGetProgramInfoLog(program, sizeof(log), NULL, log);
		glDeleteProgram(program);
		return say_why(why, "a program", log);
	}
	*ret = program;
	return 0;
}
