// Texts that are indented by hand, and texts that end too early, which must not be read beyond their end.
#include "gmwm/json_text.hpp"

#include <string>

#include "check.hpp"

int main() {
  return check::at_each_level("json_text", [] {
    CHECK(gmwm::indented("") == "");
    CHECK(gmwm::indented("3.5") == "3.5");
    CHECK(gmwm::indented("[]") == "[]");
    CHECK(gmwm::indented("[[],{}]") == "[\n [],\n {}\n]");
    CHECK(gmwm::indented(R"({"a": [1,{"b": null}],"c": "d"})") ==
          "{\n \"a\": [\n  1,\n  {\n   \"b\": null\n  }\n ],\n \"c\": \"d\"\n}");
    // Brackets, commas and quotation marks in a text are parts of it.
    CHECK(gmwm::indented(R"(["[,]{\"}","\\",2])") == "[\n \"[,]{\\\"}\",\n \"\\\\\",\n 2\n]");
    for (const std::string open : {"\"", "[", "{", "]", "}", "[\"\\", "[1,"}) CHECK(!gmwm::indented(open).empty());
  });
}
