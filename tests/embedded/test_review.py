"""What a reviewer of the C asks for: rules and their deviations, and a state that outlives the power."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from embedded.batteries import soc_export, soc_library
from markdown_pages import programs
from needs import needs_cppcheck, needs_gcc
from ohmward.battery.chemistries import generic_battery
from ohmward.embedded import battery_export, controller_export, library, write_library
from ohmward.traction import RLMA

EXPORTS = {
    "lines": lambda: soc_export("textbook-ekf"),
    "loops": lambda: soc_export("textbook-ukf", style="loops"),
    "controller": lambda: controller_export(RLMA, name="soc"),
}
FIRMWARE = ("soc.c", "soc_frame.c", "soc_saved.c")
#: Saves a state, loads it, and refuses it damaged, erased and of another library.
POWER_CYCLE = """
#include "soc_saved.h"
#include <string.h>

int main(void)
{
    soc_state state, other;
    uint8_t bytes[SOC_SAVED_BYTES];
    const soc_sample sample = {0.0f, -1.0f, 13.2f, 25.0f};
    unsigned bit;
    memset(&state, 0, sizeof state);
    memset(&other, 0, sizeof other);
    soc_start(&state, &sample, 0.5f, 0.3f);
    soc_save(&state, bytes);
    if (!soc_load(&other, bytes) || memcmp(&state, &other, sizeof state) != 0) return 1;
    memset(&other, 0, sizeof other);
    for (bit = 0; bit < 8u * sizeof bytes; ++bit) {
        bytes[bit / 8u] ^= (uint8_t)(1u << (bit % 8u));
        if (soc_load(&other, bytes) || other.current_A != 0.0f) return 2;
        bytes[bit / 8u] ^= (uint8_t)(1u << (bit % 8u));
    }
    memset(bytes, 0xFF, sizeof bytes);
    return soc_load(&other, bytes) ? 3 : 0;
}
"""


@needs_cppcheck
@pytest.mark.parametrize("kind", EXPORTS)
def test_the_readme_lists_every_deviation_from_misra(kind, tmp_path):
    files = library(EXPORTS[kind]())
    write_library(files, tmp_path)
    command = ["cppcheck", "--quiet", "--addon=misra", "--std=c99", *FIRMWARE]
    found = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True).stderr
    listed = re.findall(r"^\| ([\d., ]+) \|", files["README.md"], re.MULTILINE)
    assert listed, "the table is gone"
    rules = set(re.findall(r"misra-c2012-([\d.]+)", found))
    assert rules and rules <= {rule for row in listed for rule in row.split(", ")}, found


@needs_gcc
def test_a_state_outlives_the_power_and_no_other_is_loaded(tmp_path):
    write_library(soc_library("textbook-ekf"), tmp_path)
    (tmp_path / "main.c").write_text(POWER_CYCLE)
    warnings = ["-std=c99", "-Wall", "-Wextra", "-Wshadow", "-Wconversion", "-pedantic", "-Werror"]
    command = ["gcc", *warnings, "-fsanitize=undefined", "-o", "app", "main.c", *FIRMWARE, "-lm"]
    subprocess.run(command, cwd=tmp_path, check=True)
    assert subprocess.run([tmp_path / "app"], check=False).returncode == 0


def test_another_battery_is_another_library():
    other = library(battery_export(generic_battery("lfp", 13.0, 4), "textbook-ekf", "soc"))
    ours = soc_library("textbook-ekf")
    assert ours["soc_saved.h"] != other["soc_saved.h"]


#: As much of the boards' headers as the page's examples call.
BOARDS = {
    "stm32l4xx_hal.h": """
#include <stdint.h>
typedef enum { HAL_OK } HAL_StatusTypeDef;
typedef struct { uint32_t TypeErase, Banks, Page, NbPages; } FLASH_EraseInitTypeDef;
#define FLASH_BASE 0x08000000u
#define FLASH_PAGE_SIZE 2048u
#define FLASH_TYPEERASE_PAGES 0u
#define FLASH_BANK_1 1u
#define FLASH_TYPEPROGRAM_DOUBLEWORD 0u
HAL_StatusTypeDef HAL_FLASH_Unlock(void);
HAL_StatusTypeDef HAL_FLASH_Lock(void);
HAL_StatusTypeDef HAL_FLASHEx_Erase(FLASH_EraseInitTypeDef *, uint32_t *);
HAL_StatusTypeDef HAL_FLASH_Program(uint32_t, uint32_t, uint64_t);
""",
    "zephyr/fs/nvs.h": """
#include <stdint.h>
#include <sys/types.h>
struct nvs_fs { int sector; };
ssize_t nvs_write(struct nvs_fs *, uint16_t, const void *, size_t);
ssize_t nvs_read(struct nvs_fs *, uint16_t, void *, size_t);
""",
    "EEPROM.h": """
#include <stdint.h>
struct Memory { void update(int, uint8_t); uint8_t read(int); } ; extern Memory EEPROM;
""",
}


@pytest.mark.parametrize(("board", "compiler"), list(zip(BOARDS, ["gcc", "gcc", "g++"], strict=True)))
def test_the_pages_boards_compile(board, compiler, tmp_path):
    if not shutil.which(compiler):
        pytest.skip(f"{compiler} is not installed")
    write_library(soc_library("textbook-ekf"), tmp_path)
    header = tmp_path / board
    header.parent.mkdir(parents=True, exist_ok=True)
    header.write_text(BOARDS[board])
    page = Path(__file__).parents[2] / "docs" / "export.md"
    (example,) = [text for text in programs(page, "c") + programs(page, "cpp") if board in text]
    source = tmp_path / ("keep.cpp" if compiler == "g++" else "keep.c")
    source.write_text(example)
    standard = "-std=c++17" if compiler == "g++" else "-std=gnu99"
    wide = [] if compiler == "g++" else ["-Wno-int-to-pointer-cast"]  # an address of the board has 32 bits
    command = [compiler, standard, "-Wall", "-Wextra", "-Werror", *wide, "-I.", "-c", source.name]
    subprocess.run(command, cwd=tmp_path, check=True)
