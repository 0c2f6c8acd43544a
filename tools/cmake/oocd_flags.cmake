# SPDX-License-Identifier: MIT
# Flags that hold for every target of ours.  oocd_flags carries them; nothing is set globally, so
# that a dependency's headers are not judged by our warnings.
add_library(oocd_flags INTERFACE)
target_include_directories(oocd_flags INTERFACE ${CMAKE_SOURCE_DIR})
target_compile_definitions(oocd_flags INTERFACE
	_GNU_SOURCE _FILE_OFFSET_BITS=64 OOCD_VERSION="${PROJECT_VERSION}"
	$<$<CONFIG:Debug>:OOCD_DEBUG=1>)
target_compile_options(oocd_flags INTERFACE
	-Wall -Wextra -Werror -Wshadow -Wvla -Wundef -Wpointer-arith -Wcast-align
	-Wwrite-strings -Wimplicit-fallthrough -Wformat=2 -Wno-format-nonliteral
	-Wno-missing-field-initializers -fno-common -fno-math-errno -fno-trapping-math
	# The two rasterisers and builds on different machines must agree to the bit.
	-ffp-contract=off
	# gcc 12's vectoriser of straight-line code takes (double)(float)x for x, so that what was to be
	# rounded is not (test_camera has the case).
	$<$<OR:$<C_COMPILER_ID:GNU>,$<CXX_COMPILER_ID:GNU>>:-fno-tree-slp-vectorize>
	-fstack-protector-strong
	$<$<COMPILE_LANGUAGE:C>:-Wstrict-prototypes -Wmissing-prototypes -Wold-style-definition>
	$<$<NOT:$<CONFIG:Debug>>:-O3 -g1>)
if(OOCD_SANITIZE)
	target_compile_options(oocd_flags INTERFACE
		-fsanitize=${OOCD_SANITIZE} -fno-omit-frame-pointer -fno-sanitize-recover=all -O1)
	target_link_options(oocd_flags INTERFACE -fsanitize=${OOCD_SANITIZE})
	target_compile_definitions(oocd_flags INTERFACE OOCD_SANITIZED=1)
endif()
