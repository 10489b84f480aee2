# Programs of the OpenIGTLink library, built from the sources that Debian ships as documentation
# (openigtlink-examples): real peers for tests, by other people. Without those sources nothing is built, and the test
# says so and is skipped.
#   gnathion_igtl_examples(TEST target FOLDER name DEFINE macro PROGRAMS Folder/Program ...)
# builds igtl_Program into FOLDER of the build and tells TEST by MACRO where.
set(IGTL_EXAMPLES /usr/share/doc/openigtlink-examples/examples)
function(gnathion_igtl_examples)
  cmake_parse_arguments(arg "" "TEST;FOLDER;DEFINE" "PROGRAMS" ${ARGN})
  if(NOT TARGET ${arg_TEST} OR NOT EXISTS ${IGTL_EXAMPLES})
    return()
  endif()
  foreach(program ${arg_PROGRAMS})
    get_filename_component(name ${program} NAME)
    add_executable(igtl_${name} ${IGTL_EXAMPLES}/${program}.cxx)
    set_target_properties(igtl_${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${CMAKE_CURRENT_BINARY_DIR}/${arg_FOLDER})
    target_compile_options(igtl_${name} PRIVATE -w)
    target_include_directories(igtl_${name} SYSTEM PRIVATE ${OpenIGTLink_INCLUDE_DIRS})
    target_link_libraries(igtl_${name} PRIVATE ${OpenIGTLink_LIBRARIES} Threads::Threads)
    add_dependencies(${arg_TEST} igtl_${name})
  endforeach()
  target_compile_definitions(${arg_TEST} PRIVATE ${arg_DEFINE}="${CMAKE_CURRENT_BINARY_DIR}/${arg_FOLDER}")
endfunction()
