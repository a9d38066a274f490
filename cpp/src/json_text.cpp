#include "gmwm/json_text.hpp"

#include <cstddef>

namespace gmwm {

std::string indented(std::string_view json) {
  std::string text, line = "\n";  // the end of a line, and the indentation of the next one
  text.reserve(2 * json.size());
  for (std::size_t i = 0; i < json.size(); ++i) {
    const char c = json[i];
    if (c == '"') {
      std::size_t end = i + 1;
      while (end < json.size() && json[end] != '"') end += json[end] == '\\' ? 2 : 1;
      text.append(json.substr(i, end + 1 - i));
      i = end;
    } else if (c == '[' || c == '{') {
      text += c;
      if (i + 1 < json.size() && json[i + 1] == c + 2) {  // both closing brackets follow after one other character
        text += json[++i];
        continue;
      }
      text += line += ' ';
    } else if (c == ']' || c == '}') {
      if (line.size() > 1) line.pop_back();
      text += line;
      text += c;
    } else {
      text += c;
      if (c == ',') text += line;
    }
  }
  return text;
}

}  // namespace gmwm
