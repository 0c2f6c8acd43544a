/* SPDX-License-Identifier: MIT */
/**
 * shader.h - GLSL programs from the texts in viewer/shaders, which are part of the program.
 *
 * Threads: the GL thread.
 */
#ifndef VIEWER_SHADER_H
#define VIEWER_SHADER_H

#include <epoxy/gl.h>

#include "formats/base/why.h"

extern const char shader_text_model_vert[];
extern const char shader_text_surface_glsl[];
extern const char shader_text_shade_frag[];
extern const char shader_text_item_frag[];
extern const char shader_text_normal_frag[];
extern const char shader_text_box_vert[];
extern const char shader_text_box_flag_frag[];
extern const char shader_text_box_query_frag[];
extern const char shader_text_text_vert[];
extern const char shader_text_text_frag[];

/**
 * Compiles and links a program.
 *
 * common:  put in front of the fragment shader; "" for nothing.
 *
 * Returns: 0, or -EUCLEAN with what the driver says.
 * Ownership: glDeleteProgram(*ret).
 */
int shader_program_create(const char *vertex, const char *common, const char *fragment, GLuint *ret,
			  struct why *why);

#endif /* VIEWER_SHADER_H */
