# SPDX-License-Identifier: MIT
oocd_test(test_base unit SOURCES unit/test_base.c LINK oocd_base)

# Sanitizers change nothing about the text of the sources.
if(NOT OOCD_SANITIZE AND CMAKE_C_COMPILER_ID STREQUAL "GNU")
	foreach(rule levels format licence headers readme)
		add_test(NAME rules.${rule} COMMAND ${CMAKE_SOURCE_DIR}/tools/check-rules ${rule})
		set_tests_properties(rules.${rule} PROPERTIES LABELS rules TIMEOUT 120)
	endforeach()
endif()
