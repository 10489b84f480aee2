# gnathion_embed_text(TARGET FILE SYMBOL): FILE (relative to the root) becomes the string `gnathion::SYMBOL`, which a
# header declares as `extern const char* const SYMBOL;`. An edit of FILE runs CMake again.
function(gnathion_embed_text target file symbol)
  if(NOT TARGET ${target})
    return()
  endif()
  set(source ${CMAKE_SOURCE_DIR}/${file})
  set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${source})
  file(READ ${source} text)
  string(FIND "${text}" ")gnathion\"" end)
  if(NOT end EQUAL -1)
    message(FATAL_ERROR "${file} holds the end mark of the raw string")
  endif()
  set(out ${CMAKE_BINARY_DIR}/embedded/${symbol}.cc)
  file(CONFIGURE OUTPUT ${out} CONTENT
    "namespace gnathion {\nextern const char* const ${symbol};\nconst char* const ${symbol} = R\"gnathion(@text@)gnathion\";\n}\n" @ONLY)
  target_sources(${target} PRIVATE ${out})
endfunction()
