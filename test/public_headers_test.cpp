// Public headers document each function, and the index of pliant.h names each one.
#include <gtest/gtest.h>

#include <fstream>
#include <glob.h>
#include <iterator>
#include <map>
#include <regex>
#include <set>
#include <sstream>
#include <string>
#include <vector>

namespace {

const std::string FOLDER = PLIANT_SOURCE_DIR "/include/pliant/";

std::string file_text(const std::string &path)
{
    std::ifstream file(path);
    return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

struct Function {
    std::string header, result, comment;
    std::vector<std::string> parameters;
};

// "const double tip[3]" -> tip
std::string name_of(const std::string &parameter)
{
    const std::string bare = parameter.substr(0, parameter.find('['));
    const size_t begin = bare.find_last_of(" *");
    return begin == std::string::npos ? "" : bare.substr(begin + 1);
}

std::map<std::string, Function> public_functions()
{
    std::map<std::string, Function> functions;
    glob_t found{};
    if (glob((FOLDER + "*.h").c_str(), 0, nullptr, &found) != 0) return functions;
    for (size_t f = 0; f < found.gl_pathc; f++) {
        const std::string text = file_text(found.gl_pathv[f]);
        const std::regex prototype("PLIANT_API ([\\w ]+?[ *]+)(pliant_\\w+)\\(([^;]*)\\);");
        for (std::sregex_iterator at(text.begin(), text.end(), prototype), end; at != end; ++at) {
            Function function;
            function.header = std::string(found.gl_pathv[f]).substr(FOLDER.size());
            function.result = (*at)[1];
            const size_t begin = static_cast<size_t>(at->position());
            if (begin >= 4 && text.compare(begin - 4, 4, " */\n") == 0)
                function.comment = text.substr(text.rfind("/**", begin), begin - text.rfind("/**", begin));
            std::stringstream parameters((*at)[3]);
            for (std::string parameter; std::getline(parameters, parameter, ',');)
                if (!name_of(parameter).empty()) function.parameters.push_back(name_of(parameter));
            functions[(*at)[2]] = function;
        }
    }
    globfree(&found);
    return functions;
}

} // namespace

TEST(PublicHeaders, EachFunctionIsDocumented)
{
    const std::map<std::string, Function> functions = public_functions();
    ASSERT_GT(functions.size(), 100u);
    for (const auto &each : functions) {
        const Function &function = each.second;
        const std::string name = function.header + ": " + each.first;
        EXPECT_NE(function.comment, "") << name << " has no comment right before it";
        EXPECT_TRUE(std::regex_search(function.comment, std::regex("^/\\*\\* [A-Z][a-z]+ ")))
            << name << ": begin with an imperative sentence";
        for (const std::string &parameter : function.parameters)
            EXPECT_TRUE(std::regex_search(function.comment, std::regex("@param\\s+" + parameter + "\\s")))
                << name << ": @param " << parameter;
        if (function.result != "void ")
            EXPECT_NE(function.comment.find("@return"), std::string::npos) << name << ": @return";
        if (function.result == "pliant_status ")
            EXPECT_NE(function.comment.find("Errors"), std::string::npos) << name << ": name its errors";
    }
}

TEST(PublicHeaders, IndexNamesEachFunction)
{
    const std::map<std::string, Function> functions = public_functions();
    std::string text = file_text(FOLDER + "pliant.h");
    const size_t begin = text.find("Functions by task"), end = text.find("Example:");
    ASSERT_NE(begin, std::string::npos);
    ASSERT_NE(end, std::string::npos);
    text = text.substr(begin, end - begin);
    text = text.substr(text.find(" *  - "));
    std::set<std::string> named;
    std::string last; // the name that a name that begins with _ continues
    const std::regex word("\\bpliant_\\w+|[ (]_\\w+");
    for (std::sregex_iterator at(text.begin(), text.end(), word), done; at != done; ++at) {
        std::string name = at->str();
        if (name[0] != 'p') {
            name.erase(0, 1);
            size_t cut = last.size();
            while (cut != std::string::npos && cut > 0 && !functions.count(last.substr(0, cut) + name))
                cut = last.rfind('_', cut - 1);
            ASSERT_NE(cut, std::string::npos) << name << " after " << last << " is no function";
            named.insert(last.substr(0, cut) + name);
        } else {
            EXPECT_TRUE(functions.count(name)) << name << " is no function";
            named.insert(last = name);
        }
    }
    for (const auto &each : functions)
        EXPECT_TRUE(named.count(each.first)) << "the index of pliant.h lacks " << each.first;
}
