export PATH="$PWD/.venv/bin:$PATH"
jammkle up > up.log 2>&1 &                 # sim, driver and controller; the ankle is dropped onto the slope
until grep -q "jammkle: up" up.log || ! kill -0 %1; do sleep 1; done   # the nodes have found each other
sleep 3                                    # time enough to fall and be jammed by the controller
jammkle status                             # channels, vacuum, health
jammkle call controller/set_auto false     # by hand from here on: what the controller feels jams nothing
jammkle unjam                              # soft
jammkle jam --vacuum-kpa 45                # all channels, to 45 kPa below ambient
jammkle status
kill -INT %1; wait %1                      # as Ctrl-C: solenoids released, every process gone
