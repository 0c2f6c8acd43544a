# SPDX-License-Identifier: MIT
add_library(oocd_import_kit STATIC ${CMAKE_CURRENT_LIST_DIR}/unit/import_kit.c)
target_link_libraries(oocd_import_kit PUBLIC oocd_import oocd_test_helper PkgConfig::ZLIB)

foreach(name test_number test_source test_polygon test_join test_ply test_obj test_stl test_vrml
	test_inputs)
	oocd_test(${name} unit SOURCES unit/${name}.c LINK oocd_import_kit SKIPS_TSAN)
endforeach()
oocd_test(test_texture unit
	SOURCES unit/test_texture.c LINK oocd_import_kit PkgConfig::PNG PkgConfig::JPEG SKIPS_TSAN)
oocd_test(test_assimp integration
	SOURCES integration/test_assimp.c LINK oocd_import_kit Threads::Threads)
oocd_test(test_assimp_frames integration
	SOURCES integration/test_assimp_frames.c LINK oocd_import_kit)
oocd_test(test_import_data integration
	SOURCES integration/test_import_data.c LINK oocd_import_kit TIMEOUT 300 SKIPS_TSAN)

oocd_test(fault_import fault
	SOURCES fault/fault_import.c LINK oocd_import oocd_test_helper PkgConfig::PNG TIMEOUT 120)
target_link_options(fault_import PRIVATE
	-Wl,--wrap=malloc,--wrap=calloc,--wrap=realloc,--wrap=strdup,--wrap=strndup
	-Wl,--wrap=open64,--wrap=fstat64,--wrap=read,--wrap=pread64,--wrap=pwrite64)

# To fuzz the importers themselves, give -DOOCD_SANITIZE=address,undefined,fuzzer-no-link too.
add_library(oocd_fuzz_import STATIC ${CMAKE_CURRENT_LIST_DIR}/fuzz/fuzz_import.c)
target_link_libraries(oocd_fuzz_import PUBLIC oocd_import PkgConfig::XXHASH)
foreach(parser ply obj stl vrml scene gzip)
	oocd_fuzz(fuzz_${parser} LINK oocd_fuzz_import)
endforeach()
oocd_fuzz(fuzz_mtl LINK oocd_import)
oocd_fuzz(fuzz_texture LINK oocd_import)
